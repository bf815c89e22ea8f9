"""Own boards: the newest value of each goes into the published boards once; what it stands for is counted."""

import asyncio
from pathlib import Path
from typing import Final

from swarmd.broker.boards.shared_boards import LOOK_AGAIN_NS, VALUE_LIMIT, OwnBoards
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.boards.published_boards import PublishedBoards
from swarmd.broker.core.traffic import Counters
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.net import BoardPublication

PATH: Final = "plan/note"
NOTE: Final = data_id(PATH, "Note")


class Rig:
    """The boards of a node, and a board that another module writes."""

    def __init__(self, node: Node) -> None:
        self.published = PublishedBoards()
        self.published.offer((BoardPublication(PATH, NOTE, "Note"),), ChannelTable().board_max_hz)
        self.counters = Counters()
        self.boards = OwnBoards(node, self.published, self.counters)
        self.writer = node.publication(PATH, slots=8, slot_bytes=256)

    def write(self, payload: bytes, *, identity: int = NOTE) -> None:
        self.writer.publish(encode(Frame(FrameKind.BOARD, identity, 1, stamp_ns=5, payload=payload)))

    def sent(self) -> list[bytes]:
        return [value.payload for value in self.published.values(10, 1000, 100_000_000)]

    def counted(self) -> tuple[int, int]:
        channel = self.counters.channel(PATH)
        return channel.offered_frames, channel.dropped


async def test_newest_value_is_taken_and_all_counted(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        rig = Rig(node)
        rig.write(b"one")
        rig.boards.poll(0)
        assert (rig.sent(), rig.counted()) == ([b"one"], (1, 0))
        for text in (b"two", b"three", b"four"):
            rig.write(text)
        rig.boards.poll(1)
        rig.boards.poll(2)
        assert rig.counted() == (4, 0)
        rig.boards.close()
        rig.writer.close()


async def test_unfitting_or_mistyped_value_is_not_sent(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        rig = Rig(node)
        rig.write(bytes(VALUE_LIMIT + 1))
        rig.boards.poll(0)
        assert (rig.sent(), rig.counted()) == ([], (1, 1))
        rig.write(b"of another type", identity=NOTE + 1)
        rig.boards.poll(1)
        assert (rig.sent(), rig.counted()) == ([], (1, 1))
        rig.boards.close()
        rig.writer.close()


async def test_late_writer_is_found_and_unoffered_board_left(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        rig = Rig(node)
        rig.writer.close()
        rig.boards.poll(0)
        rig.writer = node.publication(PATH, slots=8, slot_bytes=256)
        rig.write(b"later")
        rig.boards.poll(LOOK_AGAIN_NS)
        assert rig.sent() == [b"later"]
        rig.published.offer((), ChannelTable().board_max_hz)
        rig.boards.poll(LOOK_AGAIN_NS + 1)
        assert await asyncio.to_thread(maps, node) == 1, "only the writer's"
        rig.boards.close()
        rig.writer.close()


def maps(node: Node) -> int:
    """How often this process has the board's ring mapped."""
    name = str(node.shm_dir / "plan.note.ring")
    return sum(name in line for line in Path("/proc/self/maps").read_text().splitlines())
