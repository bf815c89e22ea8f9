"""A pseudo-terminal that takes the place of a serial line: one end here, the other one as a file."""

import asyncio
import fcntl
import os
import pty
import termios
import tty
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Final

UNREAD_MAX_BYTES: Final = 2048
"""Beyond it the kernel keeps bytes where the opening of the line does not discard them: old measurements."""
_READ_BYTES: Final = 4096


class PseudoTerminal:
    """The device's end of a line; `link` is the file that a driver opens.

    What is written while no program reads the other end is dropped, but for its beginning.
    Raises: OSError when the link cannot be made.
    """

    def __init__(self, link: Path, on_bytes: Callable[[bytes], None]) -> None:
        self.link = link
        self.dropped = 0
        """Writes that the line did not take."""
        self._on_bytes = on_bytes
        # the other end stays open here: without it the kernel reports an error when its reader closes it
        self._master, self._slave = pty.openpty()
        try:
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            link.parent.mkdir(parents=True, exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to(os.ttyname(self._slave))
        except BaseException:
            os.close(self._slave)
            os.close(self._master)
            raise
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._master, self._readable)

    def _readable(self) -> None:
        try:
            data = os.read(self._master, _READ_BYTES)
        except BlockingIOError:
            return
        self._on_bytes(data)

    def write(self, data: bytes) -> None:
        """Writes all bytes, or drops them when those before were not read."""
        unread = array("i", [0])
        fcntl.ioctl(self._slave, termios.FIONREAD, unread)
        if unread[0] + len(data) > UNREAD_MAX_BYTES:
            self.dropped += 1
            return
        try:
            os.write(self._master, data)
        except BlockingIOError:
            self.dropped += 1

    def close(self) -> None:
        """Removes the file: the device is unplugged."""
        self._loop.remove_reader(self._master)
        self.link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
