"""The seeds of a simulation: `make test` runs the first ones, `make simulations` all of them."""

import os


def seeds(few: int, every: int) -> range:
    """The first `few` seeds, or with SWARM_SEEDS=all `every` one."""
    return range(every if os.environ.get("SWARM_SEEDS") == "all" else few)
