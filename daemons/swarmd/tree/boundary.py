"""Where one thing from outside, or one step of work, may fail without the tree ending."""

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from swarmware.errors import SwarmError

log = logging.getLogger("swarm.tree")


class Boundary:
    """`with boundary("notification of uav3"): …`: what fails in the block is counted and named in the log."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        """What failed, by what it was."""

    @property
    def refused(self) -> int:
        """All of them."""
        return self.counts.total()

    @contextmanager
    def __call__(self, what: str) -> Iterator[None]:
        try:
            yield
        except SwarmError as error:
            self._count(what, "%s: refused: %s", error)
        except Exception as error:  # noqa: BLE001 - the tree's boundary: others depend on it, one item does not
            self._count(what, "%s: failed, left out: %r", error, trace=True)

    def _count(self, what: str, text: str, error: Exception, *, trace: bool = False) -> None:
        self.counts[what] += 1
        first = self.counts[what] == 1  # the count tells the rest
        level = (logging.ERROR if trace else logging.WARNING) if first else logging.DEBUG
        log.log(level, text, what, error, exc_info=error if trace and first else None)
