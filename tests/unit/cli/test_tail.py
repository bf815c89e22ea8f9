"""`log tail`: which entries it shows, and in which order, whatever the loggers' batches look like."""

import asyncio
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log.interleaving import PATIENCE_NS, Interleaving
from swarmctl.commands.log.tail import SegmentFollower, follow
from swarmware.model.clock import utc_ns
from swarmware.module.module import Module
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.segment import LogChannel, SegmentWriter
from swarmware.testing.tmpnode import make_node
from swarmware.types.log import LogStats

BEGAN = 1_000
CHANNEL = LogChannel("uav1", "nav/pose", "board", "", "uav1:nav:out")


def entry(utc_ns: int, platform: str = "uav1") -> LogEntry:
    return LogEntry(f"{platform}:nav:out", 1, platform, "nav/pose", "board", "", 0, utc_ns, b"\xc0")


def times(entries: list[LogEntry]) -> list[int]:
    return [one.utc_ns for one in entries]


def test_batch_entries_before_start_are_left_out() -> None:
    order = Interleaving(["a"], BEGAN, 0)
    order.on_batch("a", map(entry, (600, 990)), 995, 1)
    order.on_batch("a", map(entry, (997, BEGAN, 1_200)), 1_300, 2)
    assert times(order.ready(2)) == [BEGAN, 1_200]


def test_entries_of_several_loggers_are_in_order() -> None:
    order = Interleaving(["a", "b"], BEGAN, 0)
    order.on_batch("a", map(entry, (1_100, 1_500)), 1_501, 1)
    assert order.ready(1) == [], "b may come with an older one"
    order.on_batch("b", map(entry, (1_050, 1_200, 1_400)), 1_450, 2)
    assert times(order.ready(2)) == [1_050, 1_100, 1_200, 1_400]
    order.on_batch("b", map(entry, (1_460,)), 1_600, 3)
    assert times(order.ready(3)) == [1_460, 1_500]


def test_silent_logger_delays_others_for_bounded_time() -> None:
    order = Interleaving(["a", "b"], BEGAN, 0)
    assert order.deadline_ns(0) is None
    order.on_batch("a", map(entry, (1_100,)), 1_200, 10)
    assert order.ready(10) == []
    assert order.deadline_ns(10) == PATIENCE_NS
    assert times(order.ready(PATIENCE_NS)) == [1_100]
    order.on_batch("a", map(entry, (1_300, 1_400)), 1_350, PATIENCE_NS + 1)
    assert times(order.ready(PATIENCE_NS + 1)) == [1_300], "not held up again, but in its own order"
    order.on_batch("b", map(entry, (1_320,)), 1_330, PATIENCE_NS + 2)
    assert times(order.ready(PATIENCE_NS + 2)) == [1_320], "late rather than never"


def test_wall_clock_that_is_set_back_hides_nothing() -> None:
    order = Interleaving(["a"], BEGAN, 0)
    order.on_batch("a", map(entry, (1_100,)), 1_200, 1)
    order.on_batch("a", map(entry, (300, 350)), 400, 2)
    assert times(order.ready(2)) == [300, 350, 1_100]


def test_entries_before_next_segment_are_read(tmp_path: Path) -> None:
    old = SegmentWriter(tmp_path / "00000001.mcap", {})
    old.append(CHANNEL, 1, 0, BEGAN, b"\xc0")
    old.flush()
    growing = SegmentFollower(tmp_path)
    assert times(list(growing.entries())) == [BEGAN]
    old.append(CHANNEL, 2, 0, BEGAN + 1, b"\xc0")
    old.finish({}, {})
    old.close()
    new = SegmentWriter(tmp_path / "00000002.mcap", {CHANNEL.queue: 2})
    new.append(CHANNEL, 3, 0, BEGAN + 2, b"\xc0")
    new.close()
    assert times(list(growing.entries())) == [BEGAN + 1, BEGAN + 2]
    assert list(growing.entries()) == []


def test_segment_that_ring_removed_does_not_end_tail(tmp_path: Path) -> None:
    SegmentWriter(tmp_path / "00000001.mcap", {}).close()
    growing = SegmentFollower(tmp_path)
    (tmp_path / "00000001.mcap").unlink()
    new = SegmentWriter(tmp_path / "00000002.mcap", {})
    new.append(CHANNEL, 1, 0, BEGAN, b"\xc0")
    new.close()
    assert times(list(growing.entries())) == [BEGAN]


def test_late_batch_shows_nothing_before_command(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    log_dir = tmp_path / "uav1" / "data" / "log"
    log_dir.mkdir(parents=True)
    written, ended = threading.Event(), threading.Event()
    writing = threading.Thread(target=asyncio.run, args=(_log_late(config_dir, log_dir, written, ended),))
    writing.start()
    try:
        assert written.wait(10)
        began_utc_ns = utc_ns()
        found: list[LogEntry] = []
        asyncio.run(follow(CliSettings(config=str(config_dir)), "/**", found.append, 6))
    finally:
        ended.set()
        writing.join()
    shown = times(found)
    assert len(shown) == 6 and shown == sorted(shown)
    assert shown[0] >= began_utc_ns


@pytest.mark.parametrize("number, code", [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_ends_it(tmp_path: Path, number: signal.Signals, code: int) -> None:
    config_dir = make_node(tmp_path)
    log_dir = tmp_path / "uav1" / "data" / "log"
    log_dir.mkdir(parents=True)
    written, ended = threading.Event(), threading.Event()
    writing = threading.Thread(target=asyncio.run, args=(_log_late(config_dir, log_dir, written, ended),))
    writing.start()
    try:
        assert written.wait(PATIENCE_S)
        words = [sys.executable, "-m", "swarmctl", "--config", str(config_dir), "log", "tail"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as tailing:
            try:
                assert tailing.stdout is not None
                assert "/uav1/nav/pose" in tailing.stdout.readline()
                tailing.send_signal(number)
                assert tailing.wait(PATIENCE_S) == code
            finally:
                tailing.kill()
    finally:
        ended.set()
        writing.join()


async def _log_late(
    config_dir: Path, log_dir: Path, written: threading.Event, ended: threading.Event
) -> None:
    """A logger whose batches reach back half a second."""
    segment = SegmentWriter(log_dir / "00000001.mcap", {})
    async with Module("logger", config_dir=config_dir) as module:
        stats = module.writer("log/stats", LogStats)
        sequence, taken_ns = 0, utc_ns() - 500_000_000
        while not ended.is_set():
            now_ns = utc_ns()
            for part in range(4):
                sequence += 1
                segment.append(CHANNEL, sequence, 0, taken_ns + part * (now_ns - taken_ns) // 4, b"\xc0")
            segment.flush()
            taken_ns = now_ns
            stats.write(LogStats(sequence, 0, 0, 1, 1, 0, str(log_dir), complete_utc_ns=now_ns))
            written.set()
            await asyncio.sleep(0.5 if sequence == 4 else 0.05)
    segment.close()
