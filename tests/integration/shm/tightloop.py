"""Forks writers on request: each claims the ring and writes in a tight loop until it is killed.

One line on standard input, `path slots slot_bytes loan|write|stream`, makes one writer and answers with its
process number; after its death `signal <number>` follows. Every frame can be checked by itself: it is one
32-bit number over and over, and its length follows from the number.
"""

import os
import sys
from pathlib import Path

from swarmware.transport.shm.doorbell import DoorbellSenders
from swarmware.transport.shm.layout import readers_folder
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingWriter

MOST_FRAMES = 3_000_000
"""A writer that nobody kills ends by itself, in less than a minute."""


def frame(number: int, slot_bytes: int) -> bytes:
    """The frame that belongs to a sequence number."""
    words = slot_bytes // 4 - number % 5
    return number.to_bytes(4, "little") * words


def write(path: Path, slots: int, slot_bytes: int, manner: str) -> None:
    bells = ReaderNotifier(readers_folder(path), DoorbellSenders(path.parent / "bells"))
    writer = RingWriter(path, slots=slots, slot_bytes=slot_bytes)
    for number in range(writer.sequence + 1, writer.sequence + MOST_FRAMES):
        data = frame(number, slot_bytes)
        if manner == "loan":
            writer.loan(len(data))[:] = data
            writer.publish()
        else:
            writer.write(data)
        bells.notify()


def main() -> None:
    for line in sys.stdin:
        path, slots, slot_bytes, manner = line.split()
        pid = os.fork()
        if pid == 0:
            write(Path(path), int(slots), int(slot_bytes), manner)
            os._exit(0)
        print(pid, flush=True)
        _, status = os.waitpid(pid, 0)
        print("signal", os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()
