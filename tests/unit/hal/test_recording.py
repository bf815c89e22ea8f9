"""A log in place of devices: pace, stamps, repetition from the end, unreadable files."""

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.config import Config, RecordingDriver
from swarmd.hal.drivers.recording import Playback, RecordedDevices
from swarmware.recorder import spool
from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.segment import LogChannel, SegmentWriter
from swarmware.types import registry
from swarmware.types.driver import DriverTable
from swarmware.types.scalar import Blob, Float

FAST = Config(drivers=(), retry_s=0.05, report_hz=50.0, failures=1)
UTC = 1_700_000_000_000_000_000
MS = 1_000_000


def log(folder: Path, platform: str = "uav7", count: int = 40, *, step_ms: int = 10) -> Path:
    """A segment with a board, a stream and values of another platform, `step_ms` apart."""
    folder.mkdir(exist_ok=True)
    writer = SegmentWriter(folder / "00000001.mcap", {})
    writer.set_clock(UTC)
    for k in range(count):
        at = k * step_ms * MS
        for path, kind, value in (
            ("sensor/height", "board", Float(float(k))),
            ("sensor/lidar", "stream", Blob(bytes([k]))),
        ):
            channel = LogChannel(platform, path, kind, type(value).__name__, f"{platform}:hal:out")
            writer.append(channel, 2 * k + (kind == "stream") + 1, at, UTC + at, registry.encode(value))
        strange = LogChannel(platform, "sensor/strange", "board", "Unknown", f"{platform}:x:out")
        writer.append(strange, k + 1, at, UTC + at, b"\x93\x01\x02\x03")
        other = LogChannel("gcs", "sensor/height", "board", "Float", "gcs:hal:out")
        writer.append(other, k + 1, at, UTC + at + 1, registry.encode(Float(-1.0)))
    writer.close()
    return folder


def test_entries_keep_their_pace_after_stall() -> None:
    playback = Playback(UTC, 1000 * MS, 2.0)
    assert playback.local_ns(UTC + 100 * MS) == 1050 * MS
    assert playback.is_due(UTC + 100 * MS, 1050 * MS)
    assert not playback.is_due(UTC + 100 * MS, 1050 * MS - 1)
    assert playback.is_due(UTC + 100 * MS, 2050 * MS)
    assert playback.stalled_ns == 0
    assert playback.is_due(UTC + 100 * MS, 9050 * MS)
    assert playback.stalled_ns == 8000 * MS
    assert playback.local_ns(UTC + 100 * MS) == 9050 * MS
    assert not playback.is_due(UTC + 102 * MS, 9050 * MS)


@given(st.floats(0.01, 50), st.integers(0, 10**15))
def test_the_pace_is_the_speed(speed: float, passed_ns: int) -> None:
    playback = Playback(UTC, 0, speed)
    assert playback.local_ns(UTC + passed_ns) == pytest.approx(passed_ns / speed, abs=1)


async def test_log_is_published_in_order_with_stamps(tmp_path: Path) -> None:
    folder = log(tmp_path / "log")
    config = RecordingDriver(folder=str(folder), platform="uav7", speed=2.0, loop=False, wake_hz=100.0)
    driver = RecordedDevices(config)
    async with running(tmp_path, [driver], FAST) as other:
        stream = other.stream_reader("sensor/lidar", Blob)
        board = other.reader("hal/drivers", DriverTable)
        items, stamps = [], []
        for _ in range(40):
            items.append((await stream.next(20.0)).value[0])
            assert stream.meta is not None
            stamps.append(stream.meta.stamp_ns)
        assert items == list(range(40))
        assert {b - a for a, b in pairwise(stamps)} == {5 * MS}
        heights = other.reader("sensor/height", Float)
        while heights.value != Float(39.0):
            await board.changed(20.0)
        assert driver.refused == 40
        assert (await status(board, "recording", state="running")).errors == 0


async def test_log_without_platform_uses_first_and_repeats(tmp_path: Path) -> None:
    folder = log(tmp_path / "log", count=5)
    config = RecordingDriver(folder=str(folder), pattern="sensor/lidar", speed=1.0, wake_hz=100.0)
    async with running(tmp_path, [RecordedDevices(config)], FAST) as other:
        stream = other.stream_reader("sensor/lidar", Blob)
        items, stamps = [], []
        for _ in range(15):
            items.append((await stream.next(20.0)).value[0])
            assert stream.meta is not None
            stamps.append(stream.meta.stamp_ns)
        assert items == [*range(5)] * 3
        assert stamps == sorted(stamps)


async def test_absent_or_empty_log_is_named_and_awaited(tmp_path: Path) -> None:
    config = RecordingDriver(folder=str(tmp_path / "log"), pattern="sensor/lidar")
    async with running(tmp_path, [RecordedDevices(config)], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        reason = f"log folder {tmp_path}/log: no such directory; expected one with .mcap segments"
        await status(board, "recording", state="waiting", note=reason)  # without a reason before it is opened
        (tmp_path / "log").mkdir()
        assert "no entries of sensor/lidar" in (await status(board, "recording", state="failed")).note
        log(tmp_path / "log")
        await status(board, "recording", state="running")


async def test_resource_of_another_program_is_named_fault(tmp_path: Path) -> None:
    config = RecordingDriver(folder=str(tmp_path / "log"), pattern="sensor/height", wake_hz=100.0)
    async with running(tmp_path, [RecordedDevices(config)], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        await status(board, "recording", state="waiting")
        other.writer("sensor/height", Float).write(Float(0.0))
        log(tmp_path / "log")
        note = (await status(board, "recording", state="failed")).note
        assert "sensor.height.ring: process" in note


async def test_exported_log_is_replayed_like_its_folder(tmp_path: Path) -> None:
    export = tmp_path / "flight.msgpack"
    with export.open("wb") as file:
        entries = FolderSource([log(tmp_path / "log", count=5)]).entries(Query(pattern="/uav7/**"))
        assert spool.write(entries, file) == 15
    config = RecordingDriver(file=str(export), pattern="sensor/lidar", wake_hz=100.0)
    async with running(tmp_path, [RecordedDevices(config)], FAST) as other:
        stream = other.stream_reader("sensor/lidar", Blob)
        assert [(await stream.next(20.0)).value[0] for _ in range(12)] == [0, 1, 2, 3, 4] * 2 + [0, 1]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "No such file"),
        (b"", "no entries of sensor"),
        (b"\xc1", "log export --format msgpack"),
        (b"ULog\x01\x12\x35\x01", "a flight log of PX4 (ULog)"),
    ],
)
async def test_missing_empty_or_foreign_file_is_named(
    tmp_path: Path, content: bytes | None, expected: str
) -> None:
    file = tmp_path / "flight.msgpack"
    if content is not None:
        file.write_bytes(content)
    driver = RecordedDevices(RecordingDriver(file=str(file)))
    async with running(tmp_path, [driver], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        state = "waiting" if content is None else "failed"
        assert expected in (await status(board, "recording", state=state)).note


async def test_folder_of_another_program_is_named_fault(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    driver = RecordedDevices(RecordingDriver(folder=str(tmp_path / "bag")))
    async with running(tmp_path, [driver], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        found = await status(board, "recording", state="failed")
        assert "metadata.yaml: the description of a bag of ROS 2 (rosbag2): not readable here" in found.note
