"""A pseudo-terminal in place of a serial line: both directions, a reader that is absent, the file."""

import asyncio
import io
import os
import termios
from pathlib import Path

import pytest

from swarmware.runtime.pseudo_terminal import PseudoTerminal


def opened(path: Path, flags: int = os.O_RDONLY) -> io.FileIO:
    """The other end of a line; it does not become the terminal that controls this process."""
    return io.FileIO(os.open(path, flags | os.O_NOCTTY), "r+" if flags & os.O_RDWR else "r")


def descriptors() -> int:
    return len([*Path("/proc/self/fd").iterdir()])


async def test_bytes_pass_in_both_directions_unchanged(tmp_path: Path) -> None:
    received = asyncio.Queue[bytes]()
    line = PseudoTerminal(tmp_path / "dev/gnss", received.put_nowait)
    with opened(tmp_path / "dev/gnss", os.O_RDWR) as other:
        line.write(b"\x00\x03\x04\x11\r\n\xff")
        assert other.read(16) == b"\x00\x03\x04\x11\r\n\xff"
        other.write(b"\r\x03")
        async with asyncio.timeout(20.0):
            assert await received.get() == b"\r\x03"
    line.close()


async def test_line_without_reader_drops_and_works_later(tmp_path: Path) -> None:
    line = PseudoTerminal(tmp_path / "imu", lambda data: None)
    for _ in range(3000):
        line.write(bytes(42))
    assert line.dropped > 0
    with opened(tmp_path / "imu") as other:
        termios.tcflush(other, termios.TCIFLUSH)
        line.write(b"new")
        assert other.read(65536) == b"new", "what was sent before the opening is discarded by it"
    line.close()


async def test_file_exists_with_line_and_replaces_old(tmp_path: Path) -> None:
    link = tmp_path / "rc"
    link.symlink_to("/dev/pts/999999")
    before = descriptors()
    line = PseudoTerminal(link, lambda data: None)
    with opened(link) as other:
        assert os.isatty(other.fileno())
    line.close()
    assert not link.is_symlink()
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"Not a directory|File exists"):
        PseudoTerminal(tmp_path / "file/rc", lambda data: None)
    assert descriptors() == before
