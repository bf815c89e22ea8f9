"""Store and forward from the ring: each entry once and in order, gaps recorded, with a failing store."""

import contextlib
import random
from pathlib import Path

import pytest

from swarmd.logger.log_forwarder import BATCH_BYTES, LogForwarder
from swarmware.errors import NoAnswer
from swarmware.recorder.entry import Cursor, LogEntry
from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.segment import LogChannel
from swarmware.types import registry
from swarmware.types.log import LogGap
from swarmware.types.scalar import Int

QUEUE = "uav1:navigator:out"
CHANNEL = LogChannel("uav1", "nav/count", "board", "Int", QUEUE)


class Slots:
    """A store of fixed slots that can be set to fail before or after storing."""

    def __init__(self) -> None:
        self.slots: dict[str, LogEntry] = {}
        self.saved = Cursor()
        self.fails: list[str] = []

    def prepare(self) -> None:
        if self.fails and self.fails[0] == "prepare":
            self.fails.pop(0)
            raise NoAnswer("away")

    def cursor(self, platform: str) -> Cursor:
        return self.saved

    def write(self, entries: list[LogEntry], platform: str, cursor: Cursor) -> None:
        fail = self.fails.pop(0) if self.fails else ""
        if fail == "before":
            raise NoAnswer("away")
        for entry in entries[: len(entries) // 2 if fail == "half" else None]:
            self.slots[f"{entry.queue}:{entry.sequence}"] = entry
        if fail in ("half", "after"):
            raise NoAnswer("away")
        self.saved = cursor

    def numbers(self) -> list[int]:
        found = sorted((e.sequence, e.value()) for e in self.slots.values() if e.queue == QUEUE)
        return [value.value for _, value in found if isinstance(value, Int)]


def fill(ring: LogRing, numbers: range) -> None:
    for number in numbers:
        ring.append(CHANNEL, number, number, registry.encode(Int(number)))


def drain(forwarder: LogForwarder) -> None:
    for _ in range(1000):
        try:
            if forwarder.step() == 0:
                return
        except NoAnswer:
            continue
    raise AssertionError("never drained")


def test_entries_arrive_over_segments_and_while_ring_grows(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=2000)
    store = Slots()
    forwarder = LogForwarder(tmp_path, "uav1", store, batch=7)
    for start in range(0, 300, 30):
        fill(ring, range(start, start + 30))
        ring.flush()
        drain(forwarder)
        assert store.numbers() == list(range(start + 30))
    assert len(segments(tmp_path)) > 2
    ring.close()


@pytest.mark.parametrize("seed", range(50))
def test_failures_and_restarts_cause_no_gap_or_duplicate(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)
    ring = LogRing(tmp_path, segment_bytes=3000)
    store = Slots()
    forwarder = LogForwarder(tmp_path, "uav1", store, batch=chance.randint(1, 40))
    written = 0
    for _ in range(60):
        match chance.choice(["write", "write", "step", "fail", "new forwarder", "new ring"]):
            case "write":
                count = chance.randint(1, 20)
                fill(ring, range(written, written + count))
                written += count
                ring.flush()
            case "step":
                with contextlib.suppress(NoAnswer):
                    forwarder.step()
            case "fail":
                store.fails.append(chance.choice(["before", "half", "after", "prepare"]))
            case "new forwarder":
                forwarder = LogForwarder(tmp_path, "uav1", store, batch=chance.randint(1, 40))
            case "new ring":
                ring.close()
                ring = LogRing(tmp_path, segment_bytes=3000)
    ring.flush()
    store.fails.clear()
    drain(forwarder)
    ring.close()
    assert store.numbers() == list(range(written))
    assert len(store.slots) == written


def test_overwritten_entries_are_gap_with_size(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=2000, ring_bytes=8000, min_free_bytes=0)
    store = Slots()
    forwarder = LogForwarder(tmp_path, "uav1", store, batch=50)
    fill(ring, range(10))
    ring.flush()
    drain(forwarder)
    for start in range(10, 1000, 10):
        fill(ring, range(start, start + 10))
        ring.flush()
    drain(forwarder)
    ring.close()
    numbers = store.numbers()
    gaps = [value for e in store.slots.values() if isinstance(value := e.value(), LogGap)]
    assert len(gaps) == 1
    assert gaps[0].where == "ring overwritten"
    assert gaps[0].count == 1000 - len(numbers) == forwarder.gaps
    assert (gaps[0].first, gaps[0].last) == (11, 10 + gaps[0].count)


def test_zeroed_segment_end_is_damage_gap(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=2000, ring_bytes=100_000, min_free_bytes=0)
    fill(ring, range(100))
    ring.flush()
    fill(ring, range(100, 150))
    ring.close()
    first = segments(tmp_path)[0]
    data = first.read_bytes()
    first.write_bytes(data[:1500] + bytes(len(data) - 1500))
    store = Slots()
    forwarder = LogForwarder(tmp_path, "uav1", store, batch=7)
    drain(forwarder)
    (gap,) = [value for e in store.slots.values() if isinstance(value := e.value(), LogGap)]
    assert (gap.where, gap.last) == ("damaged", 100)
    assert gap.count == forwarder.gaps > 50
    assert len([e for e in store.slots.values() if e.queue == QUEUE]) == 150 - gap.count


def test_batch_of_large_entries_is_byte_bounded(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    for number in range(20):
        ring.append(CHANNEL, number, number, bytes(1 << 20))
    ring.flush()
    store = Slots()
    forwarder = LogForwarder(tmp_path, "uav1", store, batch=1000)
    assert [forwarder.step() for _ in range(6)] == [BATCH_BYTES >> 20] * 5 + [0]
    ring.append(CHANNEL, 20, 20, bytes(BATCH_BYTES + 1))
    ring.flush()
    assert forwarder.step() == 1, "one that is larger goes alone"
    ring.close()


class Narrow(Slots):
    """A store behind a link that carries a limited number of entries before the time-out."""

    capacity = 30

    def write(self, entries: list[LogEntry], platform: str, cursor: Cursor) -> None:
        if len(entries) > self.capacity:
            raise NoAnswer("timed out")
        super().write(entries, platform, cursor)


def test_batches_shrink_on_slow_link_for_while(
    tmp_path: Path,
) -> None:
    ring = LogRing(tmp_path)
    fill(ring, range(2000))
    ring.flush()
    store = Narrow()
    forwarder = LogForwarder(tmp_path, "uav1", store, batch=1000)
    drain(forwarder)
    assert store.numbers() == list(range(2000))
    store.capacity = 1000
    fill(ring, range(2000, 6000))
    ring.flush()
    sizes = [forwarder.step() for _ in range(10)]
    ring.close()
    assert max(sizes) == 1000
    assert store.numbers() == list(range(6000))
