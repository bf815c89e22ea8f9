"""Reads a ring as a stream, woken by its doorbell, until the frame `end`; prints given, lost, newest."""

import sys
from pathlib import Path

from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import readers_folder
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingReader


def main() -> None:
    path = Path(sys.argv[1])
    folder = path.parent / "bells"
    with Doorbell(folder) as doorbell, ReaderNotifier(readers_folder(path), DoorbellSenders(folder)) as bells:
        bells.add(doorbell.name)
        with RingReader(path, after=0) as reader:
            print("ready", flush=True)
            given = 0
            newest = b""
            while newest != b"end" and doorbell.wait(60):
                while (data := reader.next()) is not None:
                    given += 1
                    newest = data
            print(given, reader.lost, newest.decode(), flush=True)
        bells.remove(doorbell.name)


if __name__ == "__main__":
    main()
