"""A serial line as a bus of a driver."""

from collections.abc import Callable

from swarmd.hal.buses.bus import Bus
from swarmd.hal.driver import DeviceError, DeviceGone
from swarmware.errors import NotFound, SwarmError
from swarmware.runtime.serial_port import SerialPort


class SerialLine(Bus):
    """An open serial line, eight data bits, no parity, one stop bit, for this process alone.

    Raises: DeviceError when another process has it, or it cannot have this rate; DeviceGone when there is
    none.
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
        """Writes that the line could not take, because it is slower or its other end does not read."""
        return self._line.dropped

    def check(self) -> None:
        """Raises DeviceGone when the other end was lost."""
        try:
            self._line.check()
        except NotFound as error:
            raise DeviceGone(str(error)) from error

    def write(self, data: bytes) -> None:
        """Writes all bytes, or none of them when the line is full.

        Raises: DeviceGone when the line is lost.
        """
        try:
            self._line.write(data)
        except NotFound as error:
            raise DeviceGone(str(error)) from error

    def close(self) -> None:
        """Closes the line for other processes."""
        self._line.close()
