"""Analogue-digital converters in Linux's industrial I/O (IIO), as files below `/sys/bus/iio/devices`."""

from pathlib import Path

from swarmd.hal.buses.bus import Bus, opening_error
from swarmd.hal.driver import DeviceError


class IioDevice(Bus):
    """An analogue-digital converter, on any bus that the kernel supports.

    Source: Linux, Documentation/ABI/testing/sysfs-bus-iio.
    """

    def __init__(self, folder: str) -> None:
        self.path = folder
        self._folder = Path(folder)

    def voltage_v(self, channel: int) -> float:
        """The voltage at an input. Raises: DeviceGone, DeviceError."""
        raw = self._number(f"in_voltage{channel}_raw")
        offset = self._of(channel, "offset", 0.0)
        scale_mv = self._of(channel, "scale", None)
        # the kernel states the scale in mV per step
        return (raw + offset) * scale_mv / 1000

    def _of(self, channel: int, what: str, default: float | None) -> float:
        """A property of one input, or of all inputs together if it has no own file."""
        for name in (f"in_voltage{channel}_{what}", f"in_voltage_{what}"):
            if (self._folder / name).exists():
                return self._number(name)
        return self._number(f"in_voltage_{what}") if default is None else default

    def _number(self, name: str) -> float:
        file = self._folder / name
        try:
            text = file.read_text("ascii", "replace").strip()
        except OSError as error:
            raise opening_error(str(file), error) from error
        try:
            return float(text)
        except ValueError:
            raise DeviceError(f"{file}: {text[:20]!r}, expected a number") from None

    def close(self) -> None:
        """Does nothing, because no file stays open between two readings."""
