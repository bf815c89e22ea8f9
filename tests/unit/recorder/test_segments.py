"""MCAP segments and the local ring: readable by others, bounded, whole after any cut."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from tests.simulation.seeds import examples

from swarmware.errors import InvalidInput
from swarmware.recorder import ring as ring_module
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.segment import LogChannel, SegmentReader, SegmentWriter
from swarmware.types import registry
from swarmware.types.scalar import Text
from swarmware.types.vehicle import BatteryState, Pose

POSE = LogChannel("uav1", "nav/pose", "board", "Pose", "uav1:navigator:out")
NOTE = LogChannel("uav1", "mission/note", "event", "Text", "uav1:mission:out")


def fill(ring: LogRing, count: int, start: int = 0) -> None:
    for number in range(start, start + count):
        ring.append(POSE, -5_000_000_000 + number, 1_000_000 + number, registry.encode(Pose(number, 0)))


def read(directory: Path) -> list[LogEntry]:
    return [entry for path in segments(directory) for entry in SegmentReader(path).entries()]


def test_entries_return_unchanged_with_stamps_before_epoch(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    fill(ring, 3)
    ring.append(NOTE, 7, 2_000_000, registry.encode(Text("armed")))
    ring.close()
    entries = read(tmp_path)
    assert [(e.topic, e.sequence, e.stamp_ns) for e in entries] == [
        ("/uav1/nav/pose", 1, -5_000_000_000),
        ("/uav1/nav/pose", 2, -4_999_999_999),
        ("/uav1/nav/pose", 3, -4_999_999_998),
        ("/uav1/mission/note", 1, 7),
    ]
    assert entries[1].value() == Pose(1, 0)
    assert entries[3].plain() == {"value": "armed"}


def test_foreign_mcap_reader_finds_topics_and_messages(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    fill(ring, 10)
    ring.close()
    with segments(tmp_path)[0].open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == 10
        schema, channel, message = next(iter(reader.iter_messages()))
        assert schema is not None and schema.name == "Pose" and b"prefixItems" in schema.data
        assert (channel.topic, channel.message_encoding) == ("/uav1/nav/pose", "msgpack")
        assert registry.decode(Pose, message.data) == Pose(0, 0)


def test_flushed_entries_are_readable_in_growing_segment(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    reader = SegmentReader(segments(tmp_path)[0])
    fill(ring, 5)
    ring.flush()
    assert len(list(reader.entries())) == 5
    fill(ring, 2, start=5)
    assert list(reader.entries()) == []
    ring.flush()
    assert [entry.sequence for entry in reader.entries()] == [6, 7]
    ring.close()


def test_reading_resumes_behind_offset_and_still_knows_channels(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    fill(ring, 10)
    ring.close()
    first = SegmentReader(segments(tmp_path)[0])
    entries = first.entries()
    taken = [next(entries) for _ in range(4)]
    again = SegmentReader(segments(tmp_path)[0], first.offset)
    assert taken[-1].sequence == 4
    assert [entry.sequence for entry in again.entries()] == list(range(5, 11))


def cut_file(tmp_path: Path, name: str) -> tuple[Path, int]:
    path = tmp_path / name
    writer = SegmentWriter(path, {"uav1:navigator:out": 41})
    for number in range(12):
        writer.append(POSE, 42 + number, number, number, registry.encode(Pose(number, 1)))
    writer.close()
    return path, path.stat().st_size


@given(data=st.data())
@settings(
    max_examples=examples(40, 150), suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
def test_truncation_loses_only_what_follows_it(tmp_path: Path, data: st.DataObject) -> None:
    path, size = cut_file(tmp_path, "00000001.mcap")
    try:
        whole = {entry.sequence for entry in SegmentReader(path).entries()}
        at = data.draw(st.integers(0, size))
        with path.open("r+b") as file:
            file.truncate(at)
        before = [entry.sequence for entry in SegmentReader(path).entries()]
        assert before == sorted(whole)[: len(before)]
        LogRing(tmp_path).close()
        if not path.exists():
            assert before == []
            return
        assert [entry.sequence for entry in SegmentReader(path).entries()] == before
        with path.open("rb") as file:
            assert sum(1 for _ in make_reader(file).iter_messages()) == len(before)
        again = LogRing(tmp_path)
        again.close()
        assert again.repairs.bytes == 0
    finally:
        for left in segments(tmp_path):
            left.unlink()


@given(st.binary(max_size=300))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_garbage_in_place_of_segment_yields_no_entries(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "00000001.mcap"
    for content in (data, b"\x89MCAP0\r\n" + data):
        path.write_bytes(content)
        assert isinstance(list(SegmentReader(path).entries()), list)
        LogRing(tmp_path).close()


def test_ring_after_crash_continues_with_next_sequence(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    fill(ring, 5)
    ring.flush()
    fill(ring, 3, start=5)  # never flushed: lost with the process
    path = segments(tmp_path)[0]
    data = path.read_bytes()
    ring.close()
    reader = SegmentReader(path)
    path.write_bytes(data)
    assert len(list(reader.entries())) == 5
    path.write_bytes(data[: reader.offset - 7])  # and the last whole record was cut
    again = LogRing(tmp_path)
    assert again.repairs.bytes > 0
    assert again.counters == {"uav1:navigator:out": 4}
    fill(again, 1)
    again.close()
    assert [entry.sequence for entry in read(tmp_path)] == [1, 2, 3, 4, 5]


def test_ring_keeps_bounds_and_counters_without_old_segments(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=20_000, ring_bytes=100_000, min_free_bytes=0)
    for number in range(100):
        fill(ring, 50, start=50 * number)
        ring.flush()
    count, size = ring.size()
    ring.close()
    assert count > 2
    assert size <= 100_000 + 20_000
    sequences = [entry.sequence for entry in read(tmp_path)]
    assert sequences == list(range(sequences[0], 5001))
    again = LogRing(tmp_path)
    assert again.counters == {"uav1:navigator:out": 5000}
    again.close()


def on_disk(directory: Path) -> tuple[int, int]:
    """Files, and their bytes without the room for what is not written yet."""
    sizes = []
    for path in directory.iterdir():
        reader = SegmentReader(path)
        assert list(reader.entries()) or reader.growing
        sizes.append(reader.offset if reader.growing else path.stat().st_size)
    return len(sizes), sum(sizes)


def test_size_of_ring_follows_its_files(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=20_000, ring_bytes=100_000, min_free_bytes=0, sync="none")
    for number in range(30):
        fill(ring, 50, start=50 * number)
        ring.flush()
        assert ring.size() == on_disk(tmp_path), f"batch {number}"
        assert ring.size() == on_disk(tmp_path)
    segments(tmp_path)[0].unlink()
    assert ring.size() == on_disk(tmp_path)
    segments(tmp_path)[-1].unlink()
    assert ring.size() == on_disk(tmp_path), "also without the one that is being written"
    ring.close()


def test_folder_is_listed_only_when_it_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed: list[Path] = []
    usual = ring_module._files

    def files(directory: Path) -> list[Path]:
        listed.append(directory)
        return usual(directory)

    ring = LogRing(tmp_path, segment_bytes=20_000, sync="none")
    os.utime(tmp_path, (1_000_000, 1_000_000))  # it was changed long ago
    monkeypatch.setattr(ring_module, "_files", files)
    sizes = []
    for number in range(10):
        fill(ring, 1, start=number)
        ring.flush()
        sizes.append(ring.size())
    assert len(listed) == 1
    assert sizes == sorted(set(sizes)), "each batch makes it larger"
    fill(ring, 1000)
    ring.flush()
    listed.clear()
    assert ring.size() == on_disk(tmp_path)
    assert len(listed) == 1, "a segment was added"
    ring.close()


def test_disk_without_wanted_space_gives_up_oldest_segments(tmp_path: Path) -> None:
    ring = LogRing(tmp_path, segment_bytes=10_000, min_free_bytes=1 << 62)
    for number in range(20):
        fill(ring, 50, start=50 * number)
        ring.flush()
    assert ring.size()[0] <= 2
    ring.close()


def test_unknown_type_is_kept_and_shown(tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    channel = LogChannel("uav1", "x/y", "board", "Unheard", "uav1:x:out")
    ring.append(channel, 1, 1, registry.encode(BatteryState(12.0, 1.0, 0.5)))
    ring.append(channel, 2, 2, b"\xc1")
    ring.close()
    known, broken = read(tmp_path)
    assert known.value() is None
    assert known.plain() == [12.0, 1.0, 0.5]
    assert broken.plain() is None


def test_two_writers_never_share_a_segment(tmp_path: Path) -> None:
    (tmp_path / "00000001.mcap").write_bytes(b"")
    with pytest.raises(InvalidInput, match="exists"):
        SegmentWriter(tmp_path / "00000001.mcap", {})
