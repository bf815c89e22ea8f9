"""Readings of the computer: from the kernel's files, the same as psutil's."""

from pathlib import Path

import psutil
import pytest

from swarmd.hal.drivers.computer import (
    disk_free_bytes,
    memory_used_ratio,
    temperature_degc,
)
from swarmware.runtime.processor import ProcessorUse

REST = "cpu0 1 1 1 1 1 1 1 1 1 1\nintr 4711\n"


def stat(folder: Path, *ticks: int) -> None:
    (folder / "stat").write_text(f"cpu  {' '.join(map(str, ticks))}\n{REST}")


@pytest.mark.parametrize(
    ("ticks", "expected"),
    [
        # user nice system idle iowait irq softirq steal guest guest_nice
        ((100, 0, 0, 100, 0, 0, 0, 0, 0, 0), 0.0),
        ((150, 0, 0, 150, 0, 0, 0, 0, 0, 0), 50.0),
        ((100, 10, 10, 170, 0, 5, 5, 0, 0, 0), 30.0),
        ((100, 0, 0, 120, 60, 0, 0, 20, 0, 0), 20.0),
        # time of guests is in user already
        ((150, 0, 0, 150, 0, 0, 0, 0, 50, 0), 50.0),
        # iowait went back
        ((110, 0, 0, 95, 0, 0, 0, 0, 0, 0), 100.0),
        # a kernel without the later columns
        ((125, 0, 0, 175), 25.0),
    ],
)
def test_processor_use_excludes_idle_and_waiting(
    tmp_path: Path, ticks: tuple[int, ...], expected: float
) -> None:
    stat(tmp_path, 100, 0, 0, 100, 0, 0, 0, 0, 0, 0)
    use = ProcessorUse(tmp_path)
    stat(tmp_path, *ticks)
    assert use.percent() == expected
    assert use.percent() == 0.0  # within the same tick


def test_used_memory_is_what_processes_cannot_get(tmp_path: Path) -> None:
    (tmp_path / "meminfo").write_text("MemTotal:  4000 kB\nMemFree:  100 kB\nMemAvailable:   1000 kB\n")
    assert memory_used_ratio(tmp_path) == 0.75


def test_memory_and_disk_are_those_of_psutil() -> None:
    assert memory_used_ratio() == pytest.approx(psutil.virtual_memory().percent / 100, abs=0.1)
    assert disk_free_bytes("/") == pytest.approx(psutil.disk_usage("/").free, rel=0.1)


def sensor(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_hottest_sensor_counts_and_unnumbered_is_ignored(tmp_path: Path) -> None:
    assert temperature_degc(tmp_path) is None
    sensor(tmp_path / "class/thermal/thermal_zone0/temp", "71250\n")
    assert temperature_degc(tmp_path) == 71.2
    sensor(tmp_path / "class/hwmon/hwmon0/temp1_input", "40000\n")
    sensor(tmp_path / "class/hwmon/hwmon0/temp2_input", "\n")
    sensor(tmp_path / "class/hwmon/hwmon1/device/temp1_input", "55500\n")
    (tmp_path / "class/hwmon/hwmon1/temp9_input").mkdir(parents=True)
    assert temperature_degc(tmp_path) == 55.5
