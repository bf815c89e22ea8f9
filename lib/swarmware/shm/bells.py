"""The bells of a ring: wakes all who read it, and lets readers be woken."""

import contextlib
from pathlib import Path
from types import TracebackType
from typing import Self

from swarmware.errors import Conflict, NotFound, WireError
from swarmware.shm.doorbell import NAME, BellPulls
from swarmware.shm.fence import Fence
from swarmware.shm.layout import RingFull
from swarmware.shm.readers import ENTRIES, ReadersTable, locked_table, open_table

LOCK_WAIT_S = 0.25
"""Others hold the lock for some 50 µs; one that was stopped with it in hand must not stop us too."""


class Bells:
    """The bells of one ring, of readers in this process and in others. One object belongs to one thread.

    A reader adds the name of its doorbell, once for all readers of the ring in its process, and looks at the
    ring only after that. A writer calls `ring()` after each frame, and after taking over.
    `path`: the table, `readers_file(ring)`; neither it nor the ring need be there yet.
    """

    def __init__(self, path: Path, pulls: BellPulls) -> None:
        self.path = path
        self._pulls = pulls
        self._table: ReadersTable | None = None
        self._seen = 0
        self._names: tuple[str, ...] = ()
        self._fence = Fence()

    def ring(self) -> None:
        """Wake every reader, waiting for none. Those who are gone are dropped.

        Raises: Denied, WireError, RingFull, and only when the table is new or has changed.
        """
        self._fence()  # the frame must be visible before the table is looked at, or a new reader misses both
        if self._table is None or self._table.generation != self._seen:
            self._look()
        ring = self._pulls.ring
        dead = [name for name in self._names if not ring(name)]
        if dead:
            self._drop(dead)

    def add(self, name: str) -> None:
        """Have the doorbell rung from now on; adding it twice is the same as once.

        Raises: RingFull when living readers have all entries, Conflict when the table stays locked.
        """
        if not NAME.match(name):
            raise WireError(f"{self.path}: {name!r} cannot name a doorbell, expected {NAME.pattern}")
        with locked_table(self.path, LOCK_WAIT_S, create=True) as table:
            if name not in table.names() and not table.put(name):
                for other in table.names():
                    if not self._pulls.ring(other):
                        table.clear(other)
                if not table.put(name):
                    raise RingFull(f"{self.path}: {ENTRIES} processes read this ring, expected no more")
        self._fence()

    def remove(self, name: str) -> None:
        """Have the doorbell rung no more.

        Raises: Conflict when the table stays locked.
        """
        with contextlib.suppress(NotFound), locked_table(self.path, LOCK_WAIT_S, create=False) as table:
            table.clear(name)

    def names(self) -> tuple[str, ...]:
        """The doorbells in the table, those of the dead included until the next `ring()`."""
        self._look()
        return self._names

    def _look(self) -> None:
        """Read the table again; map it first if need be, and make it if it is missing."""
        while True:
            if self._table is None or self._table.gone:
                self.close()
                self._table = open_table(self.path)
                if self._table is None:
                    with locked_table(self.path, LOCK_WAIT_S, create=True):
                        continue
            seen = self._table.generation
            self._fence()
            names = self._table.names()
            if not self._table.gone:
                self._seen, self._names = seen, names
                return

    def _drop(self, dead: list[str]) -> None:
        """Forget doorbells that nobody hears; clean the table too if that needs no waiting."""
        self._names = tuple(name for name in self._names if name not in dead)
        with contextlib.suppress(Conflict, NotFound), locked_table(self.path, 0.0, create=False) as table:
            for name in dead:
                if not self._pulls.ring(name):  # a new process may have taken the name meanwhile
                    table.clear(name)

    def close(self) -> None:
        """Let go of the table; entries stay until removed, or until their owners are gone."""
        self._names = ()
        if self._table is not None:
            self._table.close()
            self._table = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
