"""Damage on the disk: it costs the records that it met, is counted, and stops nobody."""

import errno
import os
import random
import re
from pathlib import Path

import pytest
from tests.simulation.seeds import cases

from swarmd.logger.config import Config
from swarmd.logger.core.sampling_plan import LoggedResource
from swarmd.logger.recorder import Batch, Recorder
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import ANY
from swarmware.model.resource import Kind
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.ring import LogRing, segments, set_aside
from swarmware.recorder.scan import MAGIC
from swarmware.recorder.segment import LogChannel, SegmentReader
from swarmware.types import registry
from swarmware.types.log import LogGap
from swarmware.types.scalar import Text
from swarmware.types.vehicle import Pose

POSE = LogChannel("uav1", "nav/pose", "board", "Pose", "uav1:navigator:out")
NOTE = LogChannel("uav1", "mission/note", "event", "Text", "uav1:mission:out")
COUNT = 60
SEGMENT = 16_000
"""Larger than what is written: one segment, with little room at its end."""
UTC = 1_700_000_000_000_000_000
STEP = cases([12], [4])[-1]
"""Distance from a damaged byte to the next; the first damaged byte is one of the first four."""


def write(directory: Path, *, end: bool = True, count: int = COUNT) -> Path:
    """One segment of poses and some notes."""
    ring = LogRing(directory, segment_bytes=SEGMENT)
    for number in range(count):
        ring.append(POSE, number, UTC + number, registry.encode(Pose(float(number), 0.5)))
        if number % 10 == 0:
            ring.append(NOTE, number, UTC + number, registry.encode(Text(f"note {number}")))
    path = segments(directory)[-1]
    ring.flush()
    if end:
        ring.close()
        return path
    data = path.read_bytes()
    ring.close()
    path.write_bytes(data)
    return path


def key(entry: LogEntry) -> tuple[str, int, int, bytes]:
    return entry.topic, entry.sequence, entry.stamp_ns, entry.payload


def read(path: Path) -> tuple[SegmentReader, list[LogEntry]]:
    reader = SegmentReader(path)
    return reader, list(reader.entries())


AWKWARD = [
    b"\x00",
    b"\xff",
    b"\x05",
    b"\x0f",
    b"\x02\x14",
    b"\x00" * 9,
    b"\xff" * 9,
    MAGIC,
    b"\x05" + b"\x00" * 8,
]


@pytest.mark.parametrize("end", [True, False], ids=["ended", "left by a crash"])
def test_damaged_byte_costs_only_its_record(tmp_path: Path, end: bool) -> None:
    path = write(tmp_path, end=end)
    sound = path.read_bytes()
    whole = {key(entry) for entry in read(path)[1]}
    chance = random.Random(7)
    for at in range(chance.randrange(4), len(sound), STEP):
        data = bytearray(sound)
        data[at] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
        reader, found = read(path)
        known = {key(entry) for entry in found}
        # the entry that was met may have another value, or be lost; a wrong length may reach over two more
        lost, changed = len(whole - known), len(known - whole)
        assert (lost <= 3, changed <= 1) == (True, True), f"byte {at}: {lost} lost, {changed} changed"
        if len(found) < len(whole):
            # at the very end it looks like a record that was being written
            assert reader.damaged or at >= len(sound) - 140, f"byte {at}: {len(found)} entries, none counted"


@pytest.mark.parametrize("seed", range(8))
def test_records_around_any_damage_are_read(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)
    (tmp_path / "sound").mkdir()
    sound = write(tmp_path / "sound", end=seed % 2 == 0).read_bytes()
    whole = len(read(tmp_path / "sound" / "00000001.mcap")[1])
    directory = tmp_path / "log"
    directory.mkdir()
    for _ in range(60):
        data = bytearray(sound)
        at = chance.randrange(len(data))
        end = at + chance.choice([0, 1, 1, 2, 9, 40])
        data[at:end] = chance.choice([*AWKWARD, b"", chance.randbytes(chance.randint(1, 12))])
        path = directory / "00000001.mcap"
        path.write_bytes(data)
        found = list(FolderSource([directory]).entries(Query()))
        assert len(found) >= whole - 6, f"seed {seed}, {at}:{end}"
        ring = LogRing(directory)
        ring.append(NOTE, 1, UTC, b"\xa1x")
        assert ring.counters[NOTE.queue] >= 1
        ring.close()
        for left in directory.iterdir():
            left.unlink()


def test_damaged_segment_is_counted_and_never_truncated(tmp_path: Path) -> None:
    path = write(tmp_path)
    data = bytearray(path.read_bytes())
    middle = data.index(registry.encode(Pose(30.0, 0.5)))
    data[middle - 30] ^= 0x40  # in the length of the record
    path.write_bytes(data)
    LogRing(tmp_path).close()
    assert path.read_bytes() == bytes(data)
    source = FolderSource([tmp_path])
    poses = [entry.sequence for entry in source.entries(Query(pattern="/uav1/nav/pose"))]
    assert poses == [number for number in range(1, COUNT + 1) if number != 31]
    (loss,) = source.losses()
    assert str(path) in loss and "1 place damaged" in loss


@pytest.mark.parametrize("end", [True, False], ids=["ended", "left by a crash"])
@pytest.mark.parametrize("kept", [0, 2000, 4000])
def test_a_zeroed_end_is_reported_with_its_size(tmp_path: Path, end: bool, kept: int) -> None:
    path = write(tmp_path, end=end)
    data = path.read_bytes()
    path.write_bytes(data[:kept] + bytes(len(data) - kept))
    source = FolderSource([tmp_path])
    assert len(list(source.entries(Query()))) < COUNT
    (loss,) = source.losses()
    assert "its end is missing" in loss
    lost = re.search(r"its last (\d+) bytes", loss)
    assert lost is not None
    # from the last record, of which the zeros met a part
    assert len(data) - kept - 200 <= int(lost[1]) <= len(data) - kept + 200


def test_sound_segment_has_end_and_truncated_has_none(tmp_path: Path) -> None:
    for end in (True, False):
        directory = tmp_path / str(end)
        path = write(directory, end=end)
        source = FolderSource([directory])
        assert len(list(source.entries(Query()))) == COUNT + COUNT // 10 and source.losses() == []
        path.write_bytes(path.read_bytes()[:2000])
        list(source.entries(Query()))
        (loss,) = source.losses()
        assert "its end is missing" in loss


def test_damaged_channel_is_read_from_its_second_copy(tmp_path: Path) -> None:
    path = write(tmp_path, end=False)
    data = bytearray(path.read_bytes())
    data[data.index(b"nav/pose") + 2] ^= 1
    path.write_bytes(data)
    reader, found = read(path)
    assert len([entry for entry in found if entry.topic == "/uav1/nav/pose"]) >= COUNT - 1
    assert {entry.topic for entry in found} == {"/uav1/nav/pose", "/uav1/mission/note"}
    assert reader.damaged >= 1


def test_damage_after_crash_is_hole_with_queue(tmp_path: Path) -> None:
    path = write(tmp_path, end=False)
    data = bytearray(path.read_bytes())
    data[data.index(registry.encode(Pose(30.0, 0.5))) - 30] ^= 0x40
    path.write_bytes(data)
    ring = LogRing(tmp_path)
    ring.close()
    assert ring.repairs.holes == [(POSE.queue, 31, 31)]
    assert ring.counters[POSE.queue] == COUNT


def test_unreadable_segment_is_set_aside_and_named(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_bytes(bytes(20_000))
    ring = LogRing(tmp_path)
    ring.close()
    assert [left.name for left in set_aside(tmp_path)] == ["00000001.damaged"]
    assert ring.repairs.set_aside == set_aside(tmp_path)
    source = FolderSource([tmp_path])
    assert list(source.entries(Query())) == []
    assert "00000001.damaged" in source.losses()[0]


def test_sequences_continue_despite_unreadable_newest_segment(tmp_path: Path) -> None:
    write(tmp_path)
    ring = LogRing(tmp_path)
    ring.append(POSE, 1, UTC, b"\x90")
    ring.close()
    newest = segments(tmp_path)[-1]
    newest.write_bytes(b"\x00" * 20_000)
    ring = LogRing(tmp_path)
    assert ring.counters[POSE.queue] == COUNT
    ring.close()


def read_by_this_process() -> int:
    text = Path("/proc/self/io").read_text()
    return int(next(line for line in text.splitlines() if line.startswith("rchar")).split()[1])


@pytest.mark.parametrize("end", [True, False], ids=["ended", "killed"])
def test_full_ring_starts_after_reading_one_segment(tmp_path: Path, end: bool) -> None:
    segment = 1 << 20
    ring = LogRing(tmp_path, segment_bytes=segment, min_free_bytes=0)
    payload = bytes(4000)
    for number in range(6_000):
        ring.append(POSE, number, UTC + number, payload)
        if number % 50 == 0:
            ring.flush()
    total = ring.size()[1]
    assert total > 20 * segment
    ring.flush()
    newest = segments(tmp_path)[-1]
    data = newest.read_bytes()
    ring.close()
    if not end:
        newest.write_bytes(data)
    before = read_by_this_process()
    again = LogRing(tmp_path, segment_bytes=segment, min_free_bytes=0)
    taken = read_by_this_process() - before
    assert again.counters == {POSE.queue: 6_000}
    assert again.last_stamps == {POSE.path: 5_999}
    again.close()
    assert taken < (3 * segment if not end else segment // 2)


class FullDisk:
    """Takes a few bytes of each write, then none, until there is room."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        self._pwrite = os.pwrite
        monkeypatch.setattr(os, "pwrite", self._write)

    def _write(self, fd: int, data: memoryview, offset: int) -> int:
        if not self.full:
            return self._pwrite(fd, data, offset)
        if len(data) > 10:
            return self._pwrite(fd, data[:10], offset)
        raise OSError(errno.ENOSPC, "No space left on device")


def test_full_disk_loses_nothing_once_space_returns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ring = LogRing(tmp_path, segment_bytes=3000, min_free_bytes=0)
    disk = FullDisk(monkeypatch)
    written = 0
    for batch in range(30):
        disk.full = batch % 10 in (3, 4, 5)
        for _ in range(10):
            written += 1
            ring.append(NOTE, written, UTC + written, registry.encode(Text(f"{written}")))
        if disk.full:
            with pytest.raises(OSError, match="No space"):
                ring.flush()
        else:
            ring.flush()
    ring.close()
    source = FolderSource([tmp_path])
    assert [entry.sequence for entry in source.entries(Query())] == list(range(1, written + 1))
    assert source.losses() == []


def test_overflow_of_memory_is_gap_with_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmware.recorder.segment.BUFFER_LIMIT", 5000)
    book = Recorder(tmp_path, "uav1", Config(min_free_bytes=0))
    track = LoggedResource("a/b", Kind.EVENT, "Text", "me", every_value=True, period_ns=0)
    disk = FullDisk(monkeypatch)

    def write(first: int) -> None:
        batch = Batch()
        for number in range(first, first + 50):
            frame = Frame(FrameKind.EVENT, 1, 1, 1, ANY, ANY, number, number)
            frame.payload = registry.encode(Text("x" * 20))
            batch.frames.append((track, frame, UTC + number, ""))
        book.write(batch)

    disk.full = True
    for first in range(0, 400, 50):
        with pytest.raises(OSError, match="No space"):
            write(first)
    disk.full = False
    write(400)
    book.close()
    entries = list(FolderSource([tmp_path]).entries(Query()))
    gaps = [value for entry in entries if isinstance(value := entry.value(), LogGap)]
    kept = [entry for entry in entries if entry.path == "a/b"]
    assert [(gap.where, gap.queue, gap.path) for gap in gaps] == [("disk", "uav1:me:out", "a/b")]
    assert 0 < gaps[0].count == 450 - len(kept) == book.totals.missing
    assert [entry.sequence for entry in kept] == list(range(1, len(kept) + 1))
