"""Channels of pulse-width modulation of the kernel, as files below `/sys/class/pwm`."""

import os
from pathlib import Path
from typing import Final

from swarmd.hal.buses.bus import Bus, opening_error, transfer_error
from swarmd.hal.driver import DeviceError

_US: Final = 1000
"""Nanoseconds, the kernel's unit, per microsecond."""


class PwmChannel(Bus):
    """One output of a chip such as `/sys/class/pwm/pwmchip0`; the pulses begin with the first width.

    `keeps`: running pulses of the same period, left by another process, continue until the first width.
    Source: Linux, Documentation/ABI/testing/sysfs-class-pwm.
    """

    def __init__(self, chip: str, channel: int, period_s: float, *, keeps: bool = False) -> None:
        self._folder = Path(chip) / f"pwm{channel}"
        self.path = str(self._folder)
        self._period_ns = round(period_s * 1e9)
        self._duty = -1
        self._on: bool | None = False
        """True while there are pulses, or None if another process may have changed them."""
        try:
            if not self._folder.exists():
                # the kernel creates the folder of a channel on request
                (Path(chip) / "export").write_text(f"{channel}\n", "ascii")
            if keeps and self._read("period") == self._period_ns and self._read("enable"):
                self._on = True
            else:
                # the kernel refuses a period shorter than the old pulse width, so the width is cleared first
                self._write("duty_cycle", 0)
                self._write("period", self._period_ns)
            self._duty = os.open(self._folder / "duty_cycle", os.O_WRONLY | os.O_CLOEXEC)
        except OSError as error:
            raise opening_error(self.path, error) from error

    def _write(self, name: str, value: int) -> None:
        (self._folder / name).write_text(f"{value}\n", "ascii")

    def _read(self, name: str) -> int:
        line = (self._folder / name).read_text("ascii").split("\n", 1)[0]
        return int(line) if line.isdigit() else 0

    def forget(self) -> None:
        """Takes that another process may have changed the pulses, so that the next width is always
        written."""
        self._on = None

    def set_pulse(self, width_us: float) -> None:
        """Sets the width of the pulses, or stops the pulses for 0. Raises: DeviceError."""
        if not 0 <= width_us * _US <= self._period_ns:
            raise DeviceError(f"{self.path}: pulse of {width_us:g} µs, expected at most one period")
        try:
            os.pwrite(self._duty, f"{round(width_us * _US)}\n".encode("ascii"), 0)
            # also true if the state is unknown, so that a former process's state never stays
            if (width_us > 0) != self._on:
                self._write("enable", int(width_us > 0))
                self._on = width_us > 0
        except OSError as error:
            raise transfer_error(self.path, error) from error

    def texts(self, width_us: float) -> list[tuple[str, str]]:
        """Files and texts that set a width, for the end writer."""
        found = [(str(self._folder / "duty_cycle"), f"{round(width_us * _US)}\n")]
        return found if width_us > 0 else [*found, (str(self._folder / "enable"), "0\n")]

    def close(self) -> None:
        """Closes the channel; the pulses continue at the last width, because a motor must not lose them."""
        if self._duty >= 0:
            os.close(self._duty)
            self._duty = -1
