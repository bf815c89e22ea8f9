"""Outputs of a chip after the process of their driver was killed: another process sets the safe widths."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from tests.unit.hal.pwm_chip import chip, number

from swarmd.hal.buses.end_writer import EndWriter
from swarmd.hal.buses.pwm import PwmChannel
from swarmd.hal.driver import DeviceError
from swarmware.testing.leaks import no_leaks

LONG_S = 60.0
"""Time of silence that a test does not reach."""
HELD_S = 0.3

DRIVER = """
import sys
from swarmd.hal.config import ServoDriver, ServoOutput
from swarmd.hal.drivers.servo import Servos
outputs = tuple(
    ServoOutput(channel=channel, path=f"act/output{channel}", safe_us=safe_us)
    for channel, safe_us in enumerate((1000.0, 0.0))
)
servos = Servos(ServoDriver(device=sys.argv[1], outputs=outputs))
servos.connect()
servos._carry([1800.0, 1700.0])
print(servos._end_writer.pid, flush=True)
sys.stdin.read()
servos.disconnect()
"""


@contextmanager
def driver(folder: Path) -> Iterator[tuple[subprocess.Popen[str], psutil.Process]]:
    """A process with the driver of two outputs, whose pulses are long, and the process that watches it."""
    with subprocess.Popen(
        [sys.executable, "-c", DRIVER, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        watcher = psutil.Process(int(process.stdout.readline()))
        try:
            yield process, watcher
        finally:
            process.kill()
            watcher.wait(60.0) if watcher.is_running() else None


def test_outputs_of_killed_driver_become_safe(tmp_path: Path) -> None:
    folder = chip(tmp_path)
    with driver(folder) as (process, watcher):
        assert (number(folder / "pwm0", "duty_cycle"), number(folder / "pwm1", "enable")) == (1_800_000, 1)
        for stopping in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            watcher.send_signal(stopping)  # as a supervisor that ends the whole service
        assert os.getpgid(watcher.pid) != os.getpgid(process.pid), "a kill of the group spares it"
        process.kill()
        watcher.wait(60.0)
        assert number(folder / "pwm0", "duty_cycle") == 1_000_000
        assert number(folder / "pwm0", "enable") == 1, "a motor controller wants its pulses"
        assert (number(folder / "pwm1", "duty_cycle"), number(folder / "pwm1", "enable")) == (0, 0)


def test_driver_that_ends_in_order_takes_process_along(tmp_path: Path) -> None:
    folder = chip(tmp_path)
    with driver(folder) as (process, watcher):
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(60.0) == 0
        assert not watcher.is_running()
        assert number(folder / "pwm0", "duty_cycle") == 1_000_000


def test_a_process_that_something_ended_is_started_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = chip(tmp_path, 1)
    channel = PwmChannel(str(folder), 0, 0.02)
    channel.set_pulse(1500.0)
    writer = EndWriter(channel.texts(1000.0), LONG_S)
    first = writer.pid
    writer.keep()
    assert writer.pid == first
    os.kill(first, signal.SIGKILL)
    end_s = time.monotonic() + 60.0
    while writer.pid == first:
        assert time.monotonic() < end_s
        writer.keep()
    assert "started again" in caplog.text
    assert number(folder / "pwm0", "duty_cycle") == 1_500_000, "the driver lives: nothing is stopped"
    channel.close()
    writer.close()
    assert number(folder / "pwm0", "duty_cycle") == 1_000_000


def test_writer_ending_at_start_is_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with no_leaks(), pytest.raises(DeviceError, match="ended at its start"):
        EndWriter([], LONG_S)


def test_missing_file_leaves_others_their_values(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("7")
    writer = EndWriter([(str(tmp_path / "no" / "file"), "1"), (str(tmp_path / "there"), "2")], LONG_S)
    writer.close()
    assert (tmp_path / "there").read_text() == "2"


def test_unplugged_output_is_not_created_as_file(tmp_path: Path) -> None:
    gone = tmp_path / "duty_cycle"
    gone.write_text("1500000")
    writer = EndWriter([(str(gone), "1000000")], LONG_S)
    gone.unlink()
    writer.close()
    assert not gone.exists()


def until(path: Path, wanted: str) -> None:
    end_s = time.monotonic() + 60.0
    while path.read_text() != wanted:
        assert time.monotonic() < end_s, path.read_text()


def test_outputs_of_hanging_driver_are_safe_until_return(tmp_path: Path) -> None:
    duty = tmp_path / "duty_cycle"
    duty.write_text("1500")
    writer = EndWriter([(str(duty), "1000")], HELD_S, HELD_S)
    begin_s = time.monotonic()
    for _ in range(20):
        writer.keep()
        time.sleep(HELD_S / 10)
    if time.monotonic() - begin_s < 3 * HELD_S:  # else this process was late itself
        assert duty.read_text() == "1500", "signs of life are enough"
    until(duty, "1000")
    assert writer.keep(), "the driver sets its widths again"
    duty.write_text("1600")
    assert not writer.keep()
    until(duty, "1000")
    writer.close()


def test_outputs_of_killed_driver_hold_then_become_safe(tmp_path: Path) -> None:
    duty = tmp_path / "duty_cycle"
    duty.write_text("1500")
    writer = EndWriter([(str(duty), "1000")], HELD_S, HELD_S)
    writer.keep()
    begin_s = time.monotonic()
    writer.leave()
    until(duty, "1000")
    assert time.monotonic() - begin_s > 0.5 * HELD_S
    writer.close()


def test_outputs_of_successor_driver_are_left_alone(tmp_path: Path) -> None:
    duty = tmp_path / "duty_cycle"
    duty.write_text("1500")
    writer = EndWriter([(str(duty), "1000")], 5.0, 5.0)
    writer.leave()
    process = psutil.Process(writer.pid)
    while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
        duty.write_text(f"{time.monotonic_ns() % 1000 + 1400}")
    assert duty.read_text() != "1000"
    writer.close()
