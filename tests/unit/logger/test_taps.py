"""A tap into a ring: each event is read once, also by a restarted logger, and lost events are counted."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmd.logger.core.sampling_plan import LoggedResource, logged_resource
from swarmd.logger.taps import LogTap
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.resource import Kind as ResourceKind
from swarmware.model.resource import Resource
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.ring import RingWriter
from swarmware.types import registry
from swarmware.types.scalar import Int

SLOTS = 8


@pytest.fixture
def ring(tmp_path: Path) -> Iterator[RingWriter]:
    writer = RingWriter(ring_file(tmp_path, "test/event"), slots=SLOTS, slot_bytes=128)
    yield writer
    writer.close()


def events() -> LoggedResource:
    made = logged_resource(
        Resource(path="test/event", kind=ResourceKind.EVENT, type="Int", log="all", owner="me")
    )
    assert made is not None
    return made


def write(ring: RingWriter, *numbers: int) -> None:
    for number in numbers:
        frame = Frame(
            FrameKind.EVENT, 7, sequence=number, stamp_ns=number, payload=registry.encode(Int(number))
        )
        ring.write(encode(frame))


def taken(tap: LogTap) -> tuple[list[int], int]:
    frames, lost = tap.all()
    return [frame.sequence for frame in frames], lost


def test_each_event_is_taken_or_counted_once(tmp_path: Path, ring: RingWriter) -> None:
    tap = LogTap(tmp_path, events(), None)
    write(ring, 1, 2, 3)
    assert not tap.is_idle(0)
    assert taken(tap) == ([1, 2, 3], 0)
    assert tap.is_idle(0)
    assert taken(tap) == ([], 0)
    write(ring, *range(4, 24))
    found, lost = taken(tap)
    assert found[-1] == 23
    assert len(found) + lost == 20
    assert lost >= 20 - SLOTS
    write(ring, 24)
    assert taken(tap) == ([24], 0), "what was lost before is not lost again"
    tap.close()


def test_restarted_logger_takes_only_unlogged_events(tmp_path: Path, ring: RingWriter) -> None:
    write(ring, *range(1, 20))
    tap = LogTap(tmp_path, events(), 17)
    assert taken(tap) == ([18, 19], 0), "what went before them is logged, not lost"
    write(ring, 20)
    assert taken(tap) == ([20], 0)
    tap.close()


def test_late_ring_is_found_without_constant_search(
    tmp_path: Path,
) -> None:
    tap = LogTap(tmp_path, events(), None)
    assert not tap.is_idle(0)
    assert taken(tap) == ([], 0)
    assert tap.is_idle(1)
    tap.search_again()
    with RingWriter(ring_file(tmp_path, "test/event"), slots=SLOTS, slot_bytes=128) as writer:
        write(writer, 1)
        assert not tap.is_idle(2)
        assert taken(tap) == ([1], 0)
    tap.close()
