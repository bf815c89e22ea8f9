"""What is lost of a stream on the way: counted by the sequence of its owner, also for tools."""

from pathlib import Path

from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.module.frame_reader import FrameReader
from swarmware.module.sequence_gaps import SequenceGaps
from swarmware.node.publication import Publication
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.shm.layout import ring_file


def counted(*items: tuple[int, int]) -> int:
    gaps = SequenceGaps()
    for sequence, stamp_ns in items:
        gaps.on_item(sequence, stamp_ns)
    return gaps.lost


def test_missing_numbers_count_from_first_item() -> None:
    assert counted((7, 1), (8, 2), (9, 3)) == 0
    assert counted((7, 1), (10, 2), (11, 3), (14, 4)) == 4


def test_an_owner_that_began_again_has_lost_nothing() -> None:
    assert counted((100, 50), (1, 60), (2, 70)) == 0
    assert counted((3, 50), (900, 10)) == 0, "its clock began again, too"


async def test_tool_counts_missing_items_of_mirror(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        mirror = ring_file(node.shm_dir, "map/delta", "uav7")
        mirror.parent.mkdir(exist_ok=True)
        writer = Publication(mirror, node.doorbells, slots=8, slot_bytes=256)
        reader = FrameReader(node, "/uav7/map/delta", every=True)
        found = []
        for sequence in (4, 5, 9):
            writer.publish(encode(Frame(FrameKind.STREAM, 1, 2, sequence=sequence, stamp_ns=sequence)))
            found.append((await anext(reader)).sequence)
        assert found == [4, 5, 9]
        assert reader.lost == 3
        reader.close()
        writer.close()
