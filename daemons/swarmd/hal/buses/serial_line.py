"""A serial line (UART, USB adapter, pseudo-terminal): bytes in as they arrive, bytes out without waiting."""

import asyncio
import fcntl
import os
import termios
from collections.abc import Callable
from typing import Final

from swarmd.hal.buses.bus import Bus, opening_error
from swarmd.hal.driver import DeviceError, DeviceGone

_BAUDS: Final = {
    baud: getattr(termios, f"B{baud}")
    for baud in (
        4800,
        9600,
        19200,
        38400,
        57600,
        115200,
        230400,
        460800,
        921600,
        1_000_000,
        1_500_000,
        2_000_000,
    )
}
BAUDS: Final = tuple(_BAUDS)
"""Rates that a line may have. Source: termios(3)."""
_READ_BYTES: Final = 4096


class SerialLine(Bus):
    """An open serial line, eight data bits, no parity, one stop bit, for this process alone.

    Raises: DeviceError when another process has it, or its rate is unknown; DeviceGone when it is not there.
    """

    def __init__(self, path: str, baud: int, on_bytes: Callable[[bytes], None]) -> None:
        if baud not in _BAUDS:
            raise DeviceError(f"{path}: {baud} baud, expected one of {', '.join(map(str, BAUDS))}")
        self.path = path
        self.dropped = 0
        """Writes that the line could not take, because it is slower or its other end does not read."""
        self._on_bytes = on_bytes
        self._lost = ""
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise opening_error(path, error) from error
        try:
            self._prepare(baud)
        except BaseException:
            os.close(self._fd)
            raise
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._readable)

    def _prepare(self, baud: int) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DeviceError(f"{self.path}: another process has it open") from None
        try:
            mode = termios.tcgetattr(self._fd)
        except termios.error as error:
            raise DeviceError(f"{self.path}: no serial line: {error.args[-1]}") from error
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        speed = _BAUDS[baud]
        # raw: no translation of bytes, no signals, no echo
        mode[:6] = [0, 0, control, 0, speed, speed]
        termios.tcsetattr(self._fd, termios.TCSANOW, mode)
        termios.tcflush(self._fd, termios.TCIFLUSH)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(str(error.strerror))
            return
        if data:
            self._on_bytes(data)
        else:
            self._end("end of file")

    def _end(self, reason: str) -> None:
        self._lost = f"{self.path}: unplugged: {reason}"
        self._loop.remove_reader(self._fd)

    def check(self) -> None:
        """Raises DeviceGone when the other end was lost."""
        if self._lost:
            raise DeviceGone(self._lost)

    def write(self, data: bytes) -> None:
        """Writes all bytes, or none of them when the line is full.

        Raises: DeviceGone when the line is lost.
        """
        self.check()
        try:
            sent = os.write(self._fd, data)
        except BlockingIOError:
            self.dropped += 1
            return
        if sent < len(data):
            self.dropped += 1  # the receiver discards the damaged frame

    def close(self) -> None:
        """Closes the line for other processes."""
        self._loop.remove_reader(self._fd)
        os.close(self._fd)
