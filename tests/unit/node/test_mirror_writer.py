"""The mirror writer: late items, owners that restart, withdrawn mirrors, rings that grow, garbage."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
import pytest

from swarmware.errors import InvalidInput, WireError
from swarmware.model import paths
from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.node.follower import RingFollower
from swarmware.node.mirror_writer import EPOCHS, LARGE_BYTES, ArrivalOrder, MirrorWriter
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.shm.layout import RingBusy, ring_file
from swarmware.transport.shm.ring import RingReader

OWNER = 7
HOUR_NS = 3_600_000_000_000
PATH = "power/faults"


def item(sequence: int, stamp_ns: int, *, kind: FrameKind = FrameKind.EVENT, payload: bytes = b"x") -> Frame:
    return Frame(kind, 5, OWNER, sequence=sequence, stamp_ns=stamp_ns, payload=payload)


def with_node(tmp_path: Path, test: Callable[[Node], Awaitable[None]]) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            await test(node)

    asyncio.run(run())


def follow(node: Node, path: str = PATH) -> RingFollower:
    return RingFollower(ring_file(node.shm_dir, path, "uav7"), from_oldest=True)


def taken(follower: RingFollower) -> list[int]:
    """Sequences of the items since the last call."""
    found = []
    while (frame := follower.next()) is not None:
        found.append(frame.sequence)
    return found


@pytest.mark.parametrize("kind", [FrameKind.EVENT, FrameKind.STREAM])
def test_late_or_repeated_item_is_written_once(tmp_path: Path, kind: FrameKind) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        came = [(1, 10), (2, 20), (2, 20), (1, 10), (3, 30)]
        written = [writer.write("uav7", PATH, item(*one, kind=kind), epoch=1) for one in came]
        assert written == [True, True, False, False, True]
        follower = follow(node)
        assert taken(follower) == [1, 2, 3]
        follower.close()
        writer.close()

    with_node(tmp_path, test)


def test_each_board_value_counts_in_any_order(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        for sequence, stamp_ns in ((5, 50), (1, 10)):
            assert writer.write("uav7", "a", item(sequence, stamp_ns, kind=FrameKind.BOARD), epoch=1)
        follower = follow(node, "a")
        newest = follower.newest()
        assert newest is not None
        assert newest.sequence == 1
        follower.close()
        writer.close()

    with_node(tmp_path, test)


def test_former_board_values_have_own_mirror(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        board, former = follow(node, "power/fuel"), follow(node, paths.history("power/fuel"))
        writer.write("uav7", "power/fuel", item(9, 90, kind=FrameKind.BOARD), epoch=1)
        for sequence in (8, 7, 3, 5):
            late = item(sequence, 10 * sequence, kind=FrameKind.BOARD)
            writer.write_late("uav7", "power/fuel", late, epoch=1)
        assert taken(board) == [9]
        assert taken(former) == [8, 7, 3, 5], "as they came"
        writer.prune("uav7", ["power/fuel"])
        writer.write_late("uav7", "power/fuel", item(2, 20, kind=FrameKind.BOARD), epoch=1)
        assert taken(former) == [2], "it stays with its board"
        writer.prune("uav7", ["power/other"])
        assert not list((node.shm_dir / "uav7").glob("*.ring")), "and is removed with it"
        board.close()
        former.close()
        writer.close()

    with_node(tmp_path, test)


def test_outage_of_former_values_is_readable_together(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer, former = MirrorWriter(node), follow(node, paths.history(PATH))
        for sequence in range(1000):
            writer.write_late("uav7", PATH, item(sequence, sequence, kind=FrameKind.BOARD), epoch=1)
        assert taken(former) == list(range(1000))
        former.close()
        writer.close()

    with_node(tmp_path, test)


def test_restarted_owner_continues_with_later_stamps(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        assert writer.write("uav7", PATH, item(900, HOUR_NS), epoch=1)
        assert writer.write("uav7", PATH, item(1, HOUR_NS + 1), epoch=1)
        writer.close()

    with_node(tmp_path, test)


def test_restarted_platform_begins_numbers_and_clock(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        assert writer.write("uav7", PATH, item(900, HOUR_NS), epoch=1)
        assert writer.write("uav7", PATH, item(1, 10), epoch=2), "another epoch: not a late item of the first"
        assert not writer.write("uav7", PATH, item(1, 10), epoch=2)
        assert not writer.write("uav7", PATH, item(899, HOUR_NS), epoch=1), "late, of the former epoch"
        assert writer.write("uav7", PATH, item(2, 20), epoch=2)
        follower = follow(node)
        assert taken(follower) == [900, 1, 2]
        follower.close()
        writer.close()

    with_node(tmp_path, test)


def test_only_last_epochs_of_owner_are_remembered() -> None:
    order = ArrivalOrder()
    for epoch in range(EPOCHS + 1):
        order.on_written(epoch, 5, 50)
    assert not order.is_late(0, 5, 50)
    assert all(order.is_late(epoch, 5, 50) for epoch in range(1, EPOCHS + 1))


def test_restarted_writer_repeats_nothing(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        former = MirrorWriter(node)
        former.write("uav7", PATH, item(4, 40), epoch=1)
        former.close()
        writer = MirrorWriter(node)
        assert writer.platforms() == ["uav7"]
        follower = follow(node)
        assert [writer.write("uav7", PATH, item(number, number * 10), epoch=1) for number in (3, 4, 5)] == [
            False,
            False,
            True,
        ]
        assert taken(follower) == [4, 5]
        follower.close()
        writer.close()

    with_node(tmp_path, test)


def test_value_without_number_gets_that_of_ring(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        for start in range(2):
            writer = MirrorWriter(node)
            for _ in range(2):
                writer.write("uav7", "a", item(0, 1, kind=FrameKind.BOARD))
            writer.close()
            follower = follow(node, "a")
            newest = follower.newest()
            assert newest is not None
            assert newest.sequence == 2 * start + 2
            follower.close()

    with_node(tmp_path, test)


def test_own_mirrors_are_withdrawn_not_anothers(
    tmp_path: Path,
) -> None:
    async def test(node: Node) -> None:
        former = MirrorWriter(node)
        for path in ("power/battery", "plan/a", "plan/b"):
            former.write("uav7", path, item(1, 1), epoch=1)
        former.close()
        writer = MirrorWriter(node)
        writer.write("uav7", "plan/c", item(1, 1), epoch=1)
        writer.write("uav8", "plan/c", item(1, 1), epoch=1)
        other = MirrorWriter(node)
        other.write("uav7", "nav/pose", item(0, 1, kind=FrameKind.BOARD))
        writer.prune("uav7", {"power/battery"})

        def rings(platform: str) -> list[str]:
            return sorted(ring.name for ring in (node.shm_dir / platform).glob("*.ring"))

        assert rings("uav7") == ["nav.pose.ring", "power.battery.ring"], "the other one still writes its own"
        assert rings("uav8") == ["plan.c.ring"]
        other.close()
        writer.prune("uav7", ())
        assert rings("uav7") == []
        writer.close()

    with_node(tmp_path, test)


def test_mirror_that_was_withdrawn_can_be_written_again(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        frame = item(0, 1, kind=FrameKind.BOARD)
        for path in ("nav/pose", "nav/height"):
            writer.write("uav7", path, frame)
        writer.keep_only([("uav7", "nav/height")])
        assert not ring_file(node.shm_dir, "nav/pose", "uav7").exists()
        assert writer.write("uav7", "nav/pose", frame)
        assert ring_file(node.shm_dir, "nav/pose", "uav7").exists()
        writer.close()

    with_node(tmp_path, test)


def test_ring_grows_without_losing_new_values(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        follower = follow(node)
        for sequence, size in enumerate((10, 1000, 50_000, 20), start=1):
            writer.write("uav7", PATH, item(sequence, sequence, payload=bytes(size)), epoch=1)
            frame = follower.next()
            assert frame is not None
            assert (frame.sequence, len(frame.payload)) == (sequence, size)
        follower.close()
        writer.close()

    with_node(tmp_path, test)


@pytest.mark.parametrize(
    ("kind", "size", "slots"),
    [
        (FrameKind.BOARD, 10, 4),
        (FrameKind.EVENT, 10, 512),
        (FrameKind.STREAM, 10, 1024),
        (FrameKind.STREAM, LARGE_BYTES + 1, 128),
    ],
)
def test_ring_has_room_for_window_of_its_kind(tmp_path: Path, kind: FrameKind, size: int, slots: int) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        writer.write("uav7", PATH, item(1, 1, kind=kind, payload=bytes(size)), epoch=1)
        with RingReader(ring_file(node.shm_dir, PATH, "uav7")) as ring:
            assert ring.slots == slots
        writer.close()

    with_node(tmp_path, test)


def test_resource_that_becomes_stream_gets_ring_of_stream(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        writer.write("uav7", PATH, item(9, 9, kind=FrameKind.BOARD), epoch=1)
        for number in (1, 2, 3, 4, 5, 6):
            assert writer.write("uav7", PATH, item(number, number, kind=FrameKind.STREAM), epoch=1)
        follower = follow(node)
        assert taken(follower) == [1, 2, 3, 4, 5, 6]
        follower.close()
        writer.close()

    with_node(tmp_path, test)


@pytest.mark.parametrize(
    "change",
    [
        {"data_id": 2**40},
        {"stamp_ns": 2**64 - 1},
        {"kind": FrameKind.ACK},
        {"sender_hw": -1},
        {"extension": bytes(256)},
    ],
)
def test_oversized_value_is_refused_without_ring(tmp_path: Path, change: dict[str, object]) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        garbage = msgspec.structs.replace(item(1, 1), **change)
        with pytest.raises(WireError):
            writer.write("uav7", PATH, garbage, epoch=1)
        assert writer.refused == 1
        assert not ring_file(node.shm_dir, PATH, "uav7").exists()
        assert writer.write("uav7", PATH, item(1, 1), epoch=1)
        with pytest.raises(WireError):
            writer.write("uav7", PATH, msgspec.structs.replace(garbage, sequence=2**30), epoch=1)
        assert writer.refused == 2
        assert writer.write("uav7", PATH, item(2, 2), epoch=1), "a refused item makes no other one late"
        writer.close()

    with_node(tmp_path, test)


@pytest.mark.parametrize(
    ("platform", "path"), [("../x", PATH), ("", PATH), ("uav7", "../../etc"), ("uav7", "A"), ("uav7", "")]
)
def test_a_name_that_is_none_makes_no_file(tmp_path: Path, platform: str, path: str) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        with pytest.raises(InvalidInput):
            writer.write(platform, path, item(1, 1), epoch=1)
        assert (writer.refused, writer.platforms()) == (1, [])
        writer.close()

    with_node(tmp_path, test)


def test_a_mirror_that_another_process_writes_is_refused(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        one, other = MirrorWriter(node), MirrorWriter(node)
        one.write("uav7", PATH, item(1, 1), epoch=1)
        with pytest.raises(RingBusy):
            other.write("uav7", PATH, item(2, 2), epoch=1)
        assert other.refused == 1
        one.close()
        assert other.write("uav7", PATH, item(2, 2), epoch=1)
        other.close()

    with_node(tmp_path, test)


def test_frame_is_owners_whatever_one_before_was_like(tmp_path: Path) -> None:
    async def test(node: Node) -> None:
        writer = MirrorWriter(node)
        follower = follow(node)
        frames = [
            item(1, 10, payload=b"one"),
            item(2, 20, payload=b"two"),
            item(3, 30, payload=b"three"),
            msgspec.structs.replace(item(4, 40, payload=b"three"), codec=Codec.PACKED),
            msgspec.structs.replace(item(5, 50, payload=b"three"), data_id=6),
            msgspec.structs.replace(item(6, 60, payload=b"three"), sender_hw=9),
            msgspec.structs.replace(item(7, 70, payload=b"seven"), sender_hw=9),
            msgspec.structs.replace(item(8, 80, payload=b"eight"), sender_hw=9, extension=b"more"),
            msgspec.structs.replace(item(9, 90, payload=b"nine."), sender_hw=9, extension=b"more"),
            msgspec.structs.replace(item(10, 100, payload=b""), sender_hw=9),
        ]
        for frame in frames:
            writer.write("uav7", PATH, frame, epoch=1)
        assert [follower.next() for _ in frames] == frames
        follower.close()
        writer.close()

    with_node(tmp_path, test)
