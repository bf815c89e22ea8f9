"""Wakes the readers of a ring by their doorbells, and enters and removes readers."""

import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from swarmware.errors import WireError
from swarmware.transport.shm.doorbell import NAME, DoorbellSenders
from swarmware.transport.shm.fence import Fence
from swarmware.transport.shm.layout import RingFull
from swarmware.transport.shm.readers import ENTRIES, ReadersFolder, open_readers
from swarmware.transport.shm.ringfile import file_errors


class ReaderNotifier:
    """Notifies the readers of one ring, in this process and in others. One object belongs to one thread.

    A reader adds the name of its doorbell, once for all readers of the ring in its process, and reads the
    ring only after that. A writer calls `notify()` after each frame, and after taking over.
    `path`: the folder, `readers_folder(ring)`; neither it nor the ring need exist yet.
    """

    def __init__(self, path: Path, doorbells: DoorbellSenders) -> None:
        self.path = path
        self._doorbells = doorbells
        self._folder: ReadersFolder | None = None
        self._names: tuple[str, ...] = ()
        self._fence = Fence()

    def notify(self) -> None:
        """Wake every reader without waiting for any; doorbells without an owner are removed.

        Raises: Denied, WireError, RingFull; only when the folder is missing.
        """
        self._fence()  # the frame must be visible before the folder is read, or a new reader misses both
        if self._folder is None or self._folder.changed():
            self._look()
        ring = self._doorbells.ring
        # all are rung before any is removed: removal takes a call of the file system
        dead = [name for name in self._names if not ring(name)]
        if dead:
            self._drop(dead)

    def add(self, name: str) -> None:
        """Enter a doorbell that is rung from now on; entering it twice is the same as once.

        Raises: RingFull when living readers of this user have all entries, Denied.
        """
        if not NAME.match(name):
            raise WireError(f"{self.path}: {name!r} cannot name a doorbell, expected {NAME.pattern}")
        with file_errors(self.path):
            folder = self._open()
            # the folder was removed between its opening and this call
            while not folder.add(name):
                self.close()
                folder = self._open()
            if self._crowded():
                for other in folder.names(sys.maxsize):
                    if not self._doorbells.ring(other):
                        folder.remove(other)
                if self._crowded():
                    folder.remove(name)
                    raise RingFull(
                        f"{self.path}: {ENTRIES} processes of this user read this ring, which is the limit"
                    )
        self._fence()

    def remove(self, name: str) -> None:
        """Remove the doorbell of this name."""
        folder = open_readers(self.path, create=False)
        if folder is not None:
            folder.remove(name)
            folder.close()

    def names(self) -> tuple[str, ...]:
        """The doorbells in the folder, including dead processes' until the next `notify()`."""
        self._look()
        return self._names

    def _crowded(self) -> bool:
        folder = self._open()
        self._names = folder.names()  # kept: `notify()` lists the folder only when it has changed since
        return folder.crowded

    def _open(self) -> ReadersFolder:
        if self._folder is None:
            self._folder = open_readers(self.path, create=True)
            assert self._folder is not None
        return self._folder

    def _look(self) -> None:
        """List the folder; if it was removed, open the one at the path."""
        if self._folder is not None and self._folder.gone:
            self.close()
        self._names = self._open().names()

    def _drop(self, dead: list[str]) -> None:
        """Remove doorbells that have no owner."""
        self._names = tuple(name for name in self._names if name not in dead)
        folder = self._open()
        for name in dead:
            folder.remove(name)
            if self._doorbells.ring(name):  # a new process has taken the name meanwhile
                folder.add(name)

    def close(self) -> None:
        """Close the folder; entries stay until they are removed or their owners end."""
        self._names = ()
        if self._folder is not None:
            self._folder.close()
            self._folder = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
