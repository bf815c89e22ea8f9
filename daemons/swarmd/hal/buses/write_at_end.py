"""Program that writes texts to files when its standard input is silent for too long, or has ended.

Command: `python -I -S write_at_end.py HELD_S DEAD_S FILE TEXT [FILE TEXT...]`. The program imports no
installed packages, so it starts at once and takes little memory. Its first byte of output means "ready".

Each byte of the input is a heartbeat. After HELD_S without a heartbeat the texts are written. After the end
of the input they are written DEAD_S after the last heartbeat, unless another process has changed a file
since, and so has taken over the outputs. The byte `e` is a regular end, at which the texts are written at
once.
"""

import contextlib
import os
import select
import signal
import sys
import time

_LOOKS = 20
"""Wake-ups per HELD_S; heartbeats come at the rate of control, and are read in batches to save time."""


def main(held_s: float, dead_s: float, pairs: list[str]) -> None:
    """Waits for silence or the end of the input, then writes the texts."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(
            number, signal.SIG_IGN
        )  # a supervisor that ends all processes of a service must not end this one first
    with contextlib.suppress(BrokenPipeError):  # the parent may have ended already
        os.write(1, b".")
    lived_s, silent = time.monotonic(), False
    while True:
        timeout_s = None if silent else max(0.0, lived_s + held_s - time.monotonic())
        if not select.select([0], [], [], timeout_s)[0]:
            silent = True
            write(pairs)
            continue
        found = os.read(0, 65536)
        if not found or found.endswith(b"e"):
            break
        lived_s, silent = time.monotonic(), False
        # sleeps only when all heartbeats have been read
        if not select.select([0], [], [], 0.0)[0]:
            time.sleep(held_s / _LOOKS)
    # at an end without `e` another process may continue the outputs
    if found or silent or is_ours(pairs[::2], lived_s + dead_s):
        write(pairs)


def is_ours(paths: list[str], end_s: float) -> bool:
    """Waits until an instant; returns True if no other process has changed a file by then."""
    first = [content(path) for path in paths]
    while (left_s := end_s - time.monotonic()) > 0.0:
        time.sleep(min(left_s, 0.01))
        if [content(path) for path in paths] != first:
            return False
    return True


def content(path: str) -> bytes:
    """Content of a file, or b"" if it cannot be read."""
    try:
        fd = os.open(path, os.O_RDONLY)
        try:
            return os.read(fd, 64)
        finally:
            os.close(fd)
    except OSError:  # a missing output does not change
        return b""


def write(pairs: list[str]) -> None:
    """Writes each text to its file."""
    for path, text in zip(pairs[::2], pairs[1::2], strict=True):
        try:
            # without O_CREAT: a missing output must not become a regular file
            fd = os.open(path, os.O_WRONLY | os.O_TRUNC)
            os.write(fd, text.encode("ascii"))
            os.close(fd)
        except OSError as error:
            sys.stderr.write(f"{path}: {error}\n")


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]), sys.argv[3:])
