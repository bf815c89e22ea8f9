"""Error boundary around one item or action: a failure in it does not end the tree."""

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from swarmware.errors import SwarmError

log = logging.getLogger("swarm.tree")


class Boundary:
    """`with boundary("notification of uav3"): …`: a failure in the block is counted and logged."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        """Number of failures by name."""

    @property
    def refused(self) -> int:
        """Number of all failures."""
        return self.counts.total()

    @contextmanager
    def __call__(self, what: str) -> Iterator[None]:
        try:
            yield
        except SwarmError as error:
            self._count(what, "%s: refused: %s", error)
        except Exception as error:  # noqa: BLE001 - the tree's boundary: one item must not end the tree
            self._count(what, "%s: failed, left out: %r", error, trace=True)

    def _count(self, what: str, text: str, error: Exception, *, trace: bool = False) -> None:
        self.counts[what] += 1
        # the same fault may come with every value, at hundreds a second
        first = self.counts[what] == 1  # later ones are only counted
        level = (logging.ERROR if trace else logging.WARNING) if first else logging.DEBUG
        log.log(level, text, what, error, exc_info=error if trace and first else None)
