"""Garbage collection that does not pause a node: what lives as long as the process is looked at once at most.

A full collection over the 55 000 objects of a node took 30 to 44 ms, whenever its turn came.
"""

import asyncio
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

SETTLED_S: Final = 5.0
"""After the services have started: readers, connections and tables of the other nodes are there."""


@contextmanager
def spared() -> Iterator[None]:
    """What is made meanwhile, such as imported modules, stays for good: it is not searched for garbage."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def settle(loop: asyncio.AbstractEventLoop) -> asyncio.TimerHandle:
    """In a moment, all that there is then will be spared, too."""
    return loop.call_later(SETTLED_S, _spare)


def _spare() -> None:
    gc.collect()
    gc.freeze()
