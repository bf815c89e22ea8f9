"""A serial line, as a bus for drivers."""

from collections.abc import Callable

from swarmd.hal.buses.bus import Bus
from swarmd.hal.driver import DeviceError, DeviceGone
from swarmware.errors import NotFound, SwarmError
from swarmware.runtime.serial_port import SerialPort


class SerialLine(Bus):
    """An open serial line with 8 data bits, no parity and one stop bit, used by this process alone.

    Raises: DeviceError when another process uses the line, or the line does not support the rate; DeviceGone
    when the line is missing.
    """

    def __init__(self, path: str, baud: int, on_bytes: Callable[[bytes], None]) -> None:
        self.path = path
        try:
            self._line = SerialPort(path, baud, on_bytes)
        except NotFound as error:
            raise DeviceGone(str(error)) from error
        except SwarmError as error:
            raise DeviceError(str(error)) from error

    @property
    def dropped(self) -> int:
        """Number of dropped writes, because the line is slower or its other end does not read."""
        return self._line.dropped

    def check(self) -> None:
        """Checks that the line is connected. Raises: DeviceGone."""
        try:
            self._line.check()
        except NotFound as error:
            raise DeviceGone(str(error)) from error

    def write(self, data: bytes) -> None:
        """Writes all bytes, or no byte if the line is full.

        Raises: DeviceGone when the line is lost.
        """
        try:
            self._line.write(data)
        except NotFound as error:
            raise DeviceGone(str(error)) from error

    def close(self) -> None:
        """Closes the line, so that other processes can open it."""
        self._line.close()
