"""Program: writes texts to files as soon as its standard input ends, which is when its parent has ended.

Started as `python -I -S write_at_end.py FILE TEXT [FILE TEXT...]`, it imports nothing that is installed: it
starts at once and takes little memory. The first byte of its output means that it is ready.
"""

import contextlib
import os
import signal
import sys


def main(pairs: list[str]) -> None:
    """Waits for the end of the input, then writes; a file that fails does not keep the others from it."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # a supervisor ends all processes of a service
    with contextlib.suppress(BrokenPipeError):  # the parent may have ended already
        os.write(1, b".")
    while os.read(0, 64):
        pass
    for path, text in zip(pairs[::2], pairs[1::2], strict=True):
        try:
            # an output that is gone is not made again as a file
            fd = os.open(path, os.O_WRONLY | os.O_TRUNC)
            os.write(fd, text.encode("ascii"))
            os.close(fd)
        except OSError as error:
            sys.stderr.write(f"{path}: {error}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
