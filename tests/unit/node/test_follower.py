"""The ring follower: a ring that appears, grows, is withdrawn, begins again; lost and refused frames."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.node.follower import RingFollower
from swarmware.node.publication import Publication
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.shm.doorbell import DoorbellSenders

POSE = 7
"""Data id of the frames that the followers expect."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "nav.pose.ring"


@pytest.fixture
def doorbells(tmp_path: Path) -> Iterator[DoorbellSenders]:
    senders = DoorbellSenders(tmp_path / "bells")
    yield senders
    senders.close()


def ring(path: Path, doorbells: DoorbellSenders, *, slots: int = 8, slot_bytes: int = 256) -> Publication:
    return Publication(path, doorbells, slots=slots, slot_bytes=slot_bytes)


def frame(number: int, *, data_id: int = POSE, size: int = 0) -> bytes:
    return encode(Frame(FrameKind.BOARD, data_id, 1, sequence=number, payload=bytes(size)))


def rest(follower: RingFollower) -> list[int]:
    """Sequences that `next()` gives until it has none."""
    found = []
    while (one := follower.next()) is not None:
        found.append(one.sequence)
    return found


def newest(follower: RingFollower) -> int | None:
    found = follower.newest()
    return None if found is None else found.sequence


def test_late_ring_is_read_from_first_frame(path: Path, doorbells: DoorbellSenders) -> None:
    follower = RingFollower(path, data_id=POSE)
    assert follower.next() is None and follower.newest() is None and follower.peek() is None
    assert follower.position == -1
    writer = ring(path, doorbells)
    writer.publish(frame(1))
    writer.publish(frame(2))
    assert rest(follower) == [1, 2]
    assert follower.position == 2 and follower.present
    writer.close()
    follower.close()


@pytest.mark.parametrize(("from_oldest", "expected"), [(False, [3]), (True, [1, 2, 3])])
def test_existing_ring_gives_new_or_all_frames(
    path: Path, doorbells: DoorbellSenders, from_oldest: bool, expected: list[int]
) -> None:
    writer = ring(path, doorbells)
    writer.publish(frame(1))
    writer.publish(frame(2))
    follower = RingFollower(path, data_id=POSE, from_oldest=from_oldest)
    writer.publish(frame(3))
    assert rest(follower) == expected
    writer.close()
    follower.close()


def test_newest_frame_is_given_once_peeked_always(path: Path, doorbells: DoorbellSenders) -> None:
    writer = ring(path, doorbells)
    writer.publish(frame(1))
    writer.publish(frame(2))
    follower = RingFollower(path, data_id=POSE)
    assert newest(follower) == 2
    assert newest(follower) is None
    for _ in range(2):
        peeked = follower.peek()
        assert peeked is not None and peeked.sequence == 2
    writer.publish(frame(3))
    assert newest(follower) == 3
    writer.close()
    follower.close()


def test_ring_that_grows_is_followed_without_gap(path: Path, doorbells: DoorbellSenders) -> None:
    writer = ring(path, doorbells, slot_bytes=64)
    follower = RingFollower(path, data_id=POSE)
    latest = RingFollower(path, data_id=POSE)
    writer.publish(frame(1))
    writer.publish(frame(2, size=4000))  # does not fit: the file is replaced
    writer.publish(frame(3))
    assert rest(follower) == [1, 2, 3] and follower.lost == 0
    assert newest(latest) == 3 and latest.position == 3
    writer.close()
    follower.close()
    latest.close()


def test_withdrawn_ring_still_gives_last_frame(path: Path, doorbells: DoorbellSenders) -> None:
    writer = ring(path, doorbells)
    ordered, latest = RingFollower(path, data_id=POSE), RingFollower(path, data_id=POSE)
    writer.publish(frame(1))
    writer.close()
    assert not path.exists()
    assert rest(ordered) == [1]
    assert newest(latest) == 1 and newest(latest) is None
    assert latest.peek() is None and not latest.present
    ordered.close()
    latest.close()


def test_restarted_ring_is_read_from_first_frame(path: Path, doorbells: DoorbellSenders) -> None:
    first = ring(path, doorbells)
    ordered, latest = RingFollower(path, data_id=POSE), RingFollower(path, data_id=POSE)
    for number in (1, 2, 3):
        first.publish(frame(number))
    assert rest(ordered) == [1, 2, 3] and newest(latest) == 3
    first.close()  # withdrawn: the next one has another epoch
    second = ring(path, doorbells)
    assert newest(latest) is None
    second.publish(frame(11))
    assert rest(ordered) == [11] and newest(latest) == 11
    assert ordered.position == latest.position == 4
    second.close()
    ordered.close()
    latest.close()


async def test_frame_before_opened_ring_is_reported(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        called: list[int] = []
        mine = node.shm_dir / "mine.ring"
        follower = RingFollower(mine, data_id=POSE)
        follower.listen(node, lambda: called.append(1))
        for number in (1, 2):
            writer = Publication(mine, node.doorbells, slots=4, slot_bytes=256)
            assert newest(follower) is None, "it opens the ring, which is empty yet"
            called.clear()
            writer.publish(frame(number))
            follower.poll()
            follower.poll()
            assert called == [1], "both rings have one frame now"
            assert newest(follower) == number
            writer.close()
        follower.close()


def test_what_is_overwritten_is_counted_once(path: Path, doorbells: DoorbellSenders) -> None:
    writer = ring(path, doorbells, slots=4)
    follower = RingFollower(path, data_id=POSE)
    for number in range(1, 11):
        writer.publish(frame(number))
    given = rest(follower)
    assert given == list(range(11 - len(given), 11))
    assert follower.take_lost() == 10 - len(given) == follower.lost
    assert follower.take_lost() == 0
    writer.close()
    follower.close()


@pytest.mark.parametrize("wrong", [frame(2, data_id=POSE + 1), b"no frame at all"])
def test_foreign_frame_is_refused_and_first_logged(
    path: Path, doorbells: DoorbellSenders, wrong: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    writer = ring(path, doorbells)
    ordered = RingFollower(path, name="nav/pose", data_id=POSE)
    latest = RingFollower(path, name="nav/pose", data_id=POSE)
    writer.publish(frame(1))
    assert newest(latest) == 1
    writer.publish(wrong)
    writer.publish(wrong)
    assert newest(latest) is None and latest.refused == 1
    writer.publish(frame(4))
    assert rest(ordered) == [1, 4] and ordered.refused == 2
    assert newest(latest) == 4
    assert [record.getMessage().split(": ")[:2] for record in caplog.records] == [["nav/pose", "refused"]] * 2
    writer.close()
    ordered.close()
    latest.close()


def test_without_a_data_id_every_frame_is_given(path: Path, doorbells: DoorbellSenders) -> None:
    writer = ring(path, doorbells)
    follower = RingFollower(path)
    writer.publish(frame(1, data_id=1))
    writer.publish(frame(2, data_id=2))
    assert rest(follower) == [1, 2]
    writer.close()
    follower.close()


def test_non_ring_file_is_logged_and_awaited(
    path: Path, doorbells: DoorbellSenders, caplog: pytest.LogCaptureFixture
) -> None:
    path.write_bytes(b"x" * 4096)
    follower = RingFollower(path, data_id=POSE)
    assert follower.newest() is None and follower.next() is None
    assert len(caplog.records) == 1 and str(path) in caplog.text
    writer = ring(path, doorbells)
    writer.publish(frame(1))
    assert newest(follower) == 1
    writer.close()
    follower.close()


async def test_listener_is_called_for_this_ring_only(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        called: list[int] = []
        change = asyncio.Event()
        mine, other = node.shm_dir / "mine.ring", node.shm_dir / "other.ring"
        follower = RingFollower(mine, data_id=POSE)

        def on_change() -> None:
            called.extend(rest(follower))
            change.set()

        follower.listen(node, on_change)
        elsewhere = Publication(other, node.doorbells, slots=4, slot_bytes=256)
        elsewhere.publish(frame(1))
        follower.poll()
        assert not change.is_set()
        writer = Publication(mine, node.doorbells, slots=4, slot_bytes=256)
        writer.publish(frame(1))
        async with asyncio.timeout(PATIENCE_S):
            await change.wait()
        assert called == [1]
        follower.poll()
        change.clear()
        follower.poll()
        assert not change.is_set(), "nothing has changed since"
        follower.close()
        writer.publish(frame(2))
        await asyncio.sleep(0)
        assert called == [1]
        writer.close()
        elsewhere.close()
