"""Pulse inputs of a simulated airframe: files like Linux's PWM files, which are read at each step."""

import os
import shutil
from pathlib import Path
from typing import Final

from swarmware.errors import ConfigError
from swarmware.model.airframe import Airframe, MultirotorAirframe
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.types.chassis import ActuatorOutputs

CHIP: Final = "pwmchip0"
_STOP_US, _FULL_US = 1000.0, 2000.0
"""Pulse widths at which a motor is stopped, and has full power."""
_CENTRE_US, _RANGE_US = 1500.0, 500.0
"""Pulse width of a servo at its centre, and the change to its end."""
_HELICOPTER_SERVOS: Final = 4
_DIGITS: Final = 24


class PulseInputs:
    """The channels of a PWM chip in a folder, first the motors, then the servos.

    Source: Linux, Documentation/ABI/testing/sysfs-class-pwm.
    Raises: OSError when the folder cannot be written, ConfigError for a fixed wing.
    """

    def __init__(self, folder: Path, airframe: Airframe) -> None:
        if isinstance(airframe, FixedWingAirframe):
            raise ConfigError(
                "services/sim.toml: key serial.folder: a fixed wing has no PWM driver; expected an"
                " airframe that can hover"
            )
        hovers = isinstance(airframe, MultirotorAirframe)
        self._motors = len(airframe.rotors) if isinstance(airframe, MultirotorAirframe) else 1
        self._files: list[tuple[int, int]] = []
        self._chip = chip = folder / CHIP
        for number in range(self._motors + (0 if hovers else _HELICOPTER_SERVOS)):
            channel = chip / f"pwm{number}"
            channel.mkdir(parents=True, exist_ok=True)
            for name in ("period", "duty_cycle", "enable"):
                (channel / name).write_text("0\n", "ascii")
            self._files.append((_opened(channel / "duty_cycle"), _opened(channel / "enable")))
        # a driver that lacks a channel writes its number here, as it would for the kernel
        (chip / "export").touch()

    def outputs(self) -> ActuatorOutputs:
        """Outputs by the present pulses; without pulses a motor is stopped and a servo centred."""
        # sysfs has nanoseconds
        widths = [_number(duty) / 1000 if _number(enable) else 0.0 for duty, enable in self._files]
        motors = [(width - _STOP_US) / (_FULL_US - _STOP_US) for width in widths[: self._motors]]
        servos = [(width - _CENTRE_US) / _RANGE_US if width else 0.0 for width in widths[self._motors :]]
        return ActuatorOutputs(
            tuple(min(max(one, 0.0), 1.0) for one in motors),
            tuple(min(max(one, -1.0), 1.0) for one in servos),
        )

    def close(self) -> None:
        """Closes the files of all channels and removes the chip, as if it was unplugged."""
        for pair in self._files:
            for fd in pair:
                os.close(fd)
        self._files.clear()
        shutil.rmtree(
            self._chip, ignore_errors=True
        )  # errors are ignored, because a driver may still write files


def _opened(path: Path) -> int:
    return os.open(path, os.O_RDONLY | os.O_CLOEXEC)


def _number(fd: int) -> int:
    """The number in the first line, or 0 while another process writes it."""
    line = os.pread(fd, _DIGITS, 0).split(b"\n", 1)[0]
    return int(line) if line.isdigit() else 0
