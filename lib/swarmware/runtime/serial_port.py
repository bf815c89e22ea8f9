"""A serial line (UART, USB adapter, pseudo-terminal): bytes in as they arrive, bytes out without waiting."""

import asyncio
import errno
import fcntl
import os
import struct
import termios
from collections.abc import Callable
from typing import Final

from swarmware.errors import Conflict, Denied, InvalidInput, NotFound, SwarmError

BAUD_MIN: Final = 300
BAUD_MAX: Final = 4_000_000
_MODE: Final = struct.Struct("=4IB19s2I")
"""struct termios2: flags of input, output, control and local, line discipline, characters, rates."""
_GET_MODE: Final = 0x802C542A
_SET_MODE: Final = 0x402C542B
_ANY_RATE: Final = 0o010000
"""TCGETS2, TCSETS2, BOTHER: a rate as a number, beyond the list of termios(3).

Source: Linux, asm-generic/ioctls.h and termbits.h."""
_READ_BYTES: Final = 4096
_ABSENT: Final = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR})
_FORBIDDEN: Final = frozenset({errno.EACCES, errno.EPERM})


class SerialPort:
    """An open serial line, eight data bits, no parity, one stop bit, for this process alone.

    Raises: NotFound when it does not exist, Denied without access, Conflict when another process has it,
    InvalidInput when it is not a serial line or cannot have this rate.
    """

    def __init__(
        self,
        path: str,
        baud: int,
        on_bytes: Callable[[bytes], None],
        on_lost: Callable[[], None] = lambda: None,
    ) -> None:
        """`on_lost`: called once when the line is unplugged."""
        if not BAUD_MIN <= baud <= BAUD_MAX:
            raise InvalidInput(f"{path}: {baud} baud, expected {BAUD_MIN} to {BAUD_MAX}")
        self.path = path
        self.dropped = 0
        """Writes that the line could not take, because it is slower or its other end does not read."""
        self._on_bytes = on_bytes
        self._on_lost = on_lost
        self._lost = ""
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _opening_error(path, error) from error
        try:
            self._prepare(baud)
        except BaseException:
            os.close(self._fd)
            raise
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._readable)

    def _prepare(self, baud: int) -> None:
        try:
            # two readers of one line would each get half of the bytes
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise Conflict(f"{self.path}: another process has it open") from None
        mode = bytearray(_MODE.size)
        try:
            fcntl.ioctl(self._fd, _GET_MODE, mode)
            *_, characters, _, _ = _MODE.unpack(mode)
            control = termios.CS8 | termios.CREAD | termios.CLOCAL | _ANY_RATE
            # raw: no translation of bytes, no signals, no echo
            fcntl.ioctl(self._fd, _SET_MODE, _MODE.pack(0, 0, control, 0, 0, characters, baud, baud))
        except OSError as error:
            raise InvalidInput(f"{self.path}: no serial line of {baud} baud: {error.strerror}") from error
        # what arrived before, at another rate, is noise
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
        self._on_lost()

    def check(self) -> None:
        """Raises NotFound when the other end was lost."""
        if self._lost:
            raise NotFound(self._lost)

    def write(self, data: bytes) -> None:
        """Writes all bytes, or none of them when the line is full.

        Raises: NotFound when the line is lost.
        """
        self.check()
        try:
            sent = os.write(self._fd, data)
        except BlockingIOError:
            self.dropped += 1
            return
        except OSError as error:
            self._end(str(error.strerror))
            raise NotFound(self._lost) from error
        if sent < len(data):
            self.dropped += 1  # the receiver discards the damaged frame

    def close(self) -> None:
        """Closes the line for other processes."""
        self._loop.remove_reader(self._fd)
        os.close(self._fd)


def _opening_error(path: str, error: OSError) -> SwarmError:
    if error.errno in _ABSENT:
        return NotFound(f"{path}: no such device")
    if error.errno in _FORBIDDEN:
        return Denied(f"{path}: permission denied; expected read and write access for the user of the daemon")
    return Conflict(f"{path}: {error.strerror}")
