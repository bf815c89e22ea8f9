"""A segment is a complete MCAP file at each instant: while it grows, and after any crash."""

import json
import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import DataEnd, Footer, Message
from mcap.stream_reader import StreamReader

from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.scan import RESERVED_END
from swarmware.recorder.segment import LogChannel, SegmentReader, SegmentWriter, ended
from swarmware.types import registry
from swarmware.types.scalar import Text

NOTE = LogChannel("uav1", "mission/note", "event", "Text", "uav1:mission:out")
UTC = 1_700_000_000_000_000_000
READERS: list[Callable[..., SeekingReader | NonSeekingReader]] = [SeekingReader, NonSeekingReader]


class Killed(BaseException):
    """End of the process within a write."""


class Disk:
    """Passes the first `limit` bytes of all writes to the disk, then the process ends.

    A head or an end of the file lies within one page, which the kernel writes in one step.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, limit: int) -> None:
        self.left = limit
        self._pwrite, self._truncate = os.pwrite, os.ftruncate
        monkeypatch.setattr(os, "pwrite", self._write)
        monkeypatch.setattr(os, "ftruncate", self._cut)

    def _write(self, fd: int, data: memoryview, offset: int) -> int:
        if len(data) > self.left:
            if len(data) > len(RESERVED_END):
                self._pwrite(fd, data[: self.left], offset)
            else:
                assert offset // 4096 == (offset + len(data) - 1) // 4096, "within one page"
            raise Killed
        self.left -= len(data)
        return self._pwrite(fd, data, offset)

    def _cut(self, fd: int, length: int) -> None:
        if not self.left:
            raise Killed
        self._truncate(fd, length)


def append(writer: SegmentWriter, first: int, count: int, size: int = 40) -> None:
    for number in range(first, first + count):
        text = registry.encode(Text(f"{number} " + "x" * (number * 37 % size)))
        writer.append(NOTE, number, number, UTC + number, text)


def stock(path: Path) -> list[int]:
    """Sequences that the readers of the MCAP library find: all the same, up to the end of the file."""
    found = []
    for reader in READERS:
        with path.open("rb") as file:
            found.append([m.sequence for _, _, m in reader(file).iter_messages(log_time_order=False)])
    with path.open("rb") as file:
        records = list(StreamReader(file).records)
        assert isinstance(records[-1], Footer)
        assert any(isinstance(record, DataEnd) for record in records)
        assert file.read() == b"", "nothing is behind the end"
        found.append([record.sequence for record in records if isinstance(record, Message)])
    assert found[0] == found[1] == found[2]
    return found[0]


def ours(path: Path) -> list[int]:
    return [entry.sequence for entry in SegmentReader(path).entries()]


def test_segment_is_complete_after_creation_and_batches(tmp_path: Path) -> None:
    path = tmp_path / "00000001.mcap"
    writer = SegmentWriter(path, {}, reserved_bytes=20_000)
    assert stock(path) == []
    for batch in range(60):
        append(writer, 1 + 5 * batch, 5)
        before = path.read_bytes()
        writer.flush()
        assert stock(path) == ours(path) == list(range(1, 6 + 5 * batch))
        assert not ended(path)
        assert len(path.read_bytes()) >= len(before)
    size = path.stat().st_size
    writer.finish({NOTE.queue: 300}, {})
    writer.flush()
    writer.close()
    assert stock(path) == ours(path) == list(range(1, 301))
    assert ended(path)
    assert path.stat().st_size < size, "the room is gone"
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == 300


@pytest.mark.parametrize("reserved_bytes", [30_000, 0], ids=["room left", "file has to grow"])
def test_crash_within_batch_keeps_all_or_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reserved_bytes: int
) -> None:
    outcomes = set()
    for limit in [*range(0, 7000, 61), *range(5800, 6000, 3)]:
        path = tmp_path / "00000001.mcap"
        writer = SegmentWriter(path, {}, reserved_bytes=reserved_bytes)
        append(writer, 1, 7)
        writer.flush()
        append(writer, 8, 40, size=200)
        with monkeypatch.context() as patch:
            Disk(patch, limit)
            try:
                writer.flush()
            except Killed:
                killed = True
            else:
                killed = False
        if reserved_bytes:
            found = stock(path)
        else:
            # between two writes the old end of a file that grows is in front of the new one
            with path.open("rb") as file:
                found = [m.sequence for _, _, m in make_reader(file).iter_messages(log_time_order=False)]
        assert found == ours(path)
        assert len(found) == (7 if killed else 47)
        outcomes.add(killed)
        left = path.read_bytes()
        writer._out.close()
        path.write_bytes(left)
        LogRing(tmp_path).close()
        assert stock(path) == found
        for one in tmp_path.iterdir():
            one.unlink()
    assert outcomes == {True, False}


def test_crash_within_end_keeps_every_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit in range(0, 1500, 17):
        path = tmp_path / "00000001.mcap"
        writer = SegmentWriter(path, {}, reserved_bytes=30_000)
        append(writer, 1, 7)
        writer.flush()
        writer.finish({NOTE.queue: 7}, {})
        with monkeypatch.context() as patch:
            disk = Disk(patch, limit)
            try:
                writer.flush()
            except Killed:
                pass
            else:
                assert disk.left >= 0
        with path.open("rb") as file:
            assert len(list(make_reader(file).iter_messages())) == 7
        assert ours(path) == list(range(1, 8))
        writer._out.close()
        LogRing(tmp_path).close()
        assert stock(path) == list(range(1, 8))
        for one in tmp_path.iterdir():
            one.unlink()


def test_crash_during_creation_leaves_no_visible_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in (0, 60, 100, 150):
        with monkeypatch.context() as patch:
            Disk(patch, limit)
            patch.setattr(Path, "unlink", lambda *_, **__: None)
            with pytest.raises(Killed):
                SegmentWriter(tmp_path / "00000001.mcap", {"uav1:mission:out": 3}, reserved_bytes=9000)
        assert segments(tmp_path) == []
        assert [path.name for path in tmp_path.iterdir()] == ["00000001.new.mcap"]
    ring = LogRing(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["00000001.mcap"]
    assert ring.repairs.bytes == 0
    ring.close()


CHILD = """
import sys
from pathlib import Path
from swarmware.recorder.ring import LogRing
from swarmware.recorder.scan import RESERVED_END
from swarmware.recorder.segment import LogChannel
from swarmware.types import registry
from swarmware.types.scalar import Text
ring = LogRing(Path(sys.argv[1]), segment_bytes=40_000, min_free_bytes=0)
note = LogChannel("uav1", "mission/note", "event", "Text", "uav1:mission:out")
number = 0
while sys.stdin.readline():
    for _ in range(20):
        number += 1
        text = registry.encode(Text("x" * (number % 300)))
        ring.append(note, number, 1_700_000_000_000_000_000 + number, text)
    ring.flush()
    print(number, flush=True)
"""


def test_reader_finds_flushed_entries_after_kill_9(tmp_path: Path) -> None:
    chance = random.Random(3)
    for turn in range(3):
        directory = tmp_path / str(turn)
        command = [sys.executable, "-c", CHILD, str(directory)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdin is not None and child.stdout is not None
            for _ in range(chance.randint(10, 60)):
                child.stdin.write("\n")
                child.stdin.flush()
                flushed = int(child.stdout.readline())
                beside = [number for path in segments(directory) for number in stock(path)]
                assert beside == list(range(1, flushed + 1))
            child.stdin.write("\n" * 100)
            child.stdin.flush()
            for _ in range(chance.randint(1, 40)):
                flushed = int(child.stdout.readline())
            child.kill()
        found = [number for path in segments(directory) for number in stock(path)]
        assert found == list(range(1, len(found) + 1)) and len(found) >= flushed
        LogRing(directory).close()
        entries = FolderSource([directory]).entries(Query())
        assert [entry.sequence for entry in entries] == found


def test_following_reader_sees_whole_batches(tmp_path: Path) -> None:
    path = tmp_path / "00000001.mcap"
    writer = SegmentWriter(path, {}, reserved_bytes=0)
    reader = SegmentReader(path)
    seen: list[int] = []
    for batch in range(60):
        append(writer, 1 + 9 * batch, 9, size=300)
        writer.flush()
        seen += [entry.sequence for entry in reader.entries()]
        assert seen == list(range(1, 10 + 9 * batch))
        assert (reader.damaged, reader.ended, reader.growing) == (0, False, True)
    writer.close()
    assert list(reader.entries()) == [] and reader.ended


def test_stamps_are_utc_elsewhere_and_platform_clock_here(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=3000)
    clock = UTC - 5_000_000_000
    for number in range(1, 101):
        if number == 50:
            clock += 86_400_000_000_000  # the wall clock was set
        ring.set_clock(clock + number % 1000)
        ring.append(NOTE, 5_000_000_000 + number, UTC + number, registry.encode(Text(f"{number}")))
        ring.flush()
    ring.close()
    entries = list(FolderSource([tmp_path]).entries(Query()))
    assert [entry.stamp_ns - 5_000_000_000 for entry in entries] == list(range(1, 101))
    published = []
    for path in segments(tmp_path):
        with path.open("rb") as file:
            published += [m.publish_time for _, _, m in make_reader(file).iter_messages()]
    assert len(segments(tmp_path)) > 1
    assert published == [entry.sent_utc_ns for entry in entries]
    for number, sent_ns in enumerate(published, 1):
        expected = UTC + number + (86_400_000_000_000 if number >= 50 else 0)
        assert abs(sent_ns - expected) <= 1_000_000


def test_schema_names_fields_of_array_that_message_is(tmp_path: Path) -> None:
    import jsonschema
    import msgpack

    ring = LogRing(tmp_path)
    ring.append(NOTE, 1, UTC, registry.encode(Text("armed")))
    ring.flush()
    with segments(tmp_path)[0].open("rb") as file:
        ((schema, channel, message),) = make_reader(file).iter_messages()
    ring.close()
    assert schema is not None and channel.message_encoding == "msgpack"
    described = json.loads(schema.data)
    jsonschema.Draft202012Validator.check_schema(described)
    jsonschema.validate(msgpack.unpackb(message.data), described)
