"""Seeds, cases and examples of a test: `make test` runs the first ones, `make simulations` all of them."""

import os
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def seeds(few: int, every: int) -> range:
    """The first `few` seeds, or with SWARM_SEEDS=all `every` one."""
    return range(every if os.environ.get("SWARM_SEEDS") == "all" else few)


def examples(few: int, every: int) -> int:
    """How many examples a property is tried with: `few`, or with SWARM_SEEDS=all `every` one."""
    return len(seeds(few, every))


def cases(few: Sequence[T], others: Sequence[T]) -> list[T]:
    """The cases of `few`, and with SWARM_SEEDS=all also the cases of `others`."""
    return [*few, *others] if os.environ.get("SWARM_SEEDS") == "all" else list(few)
