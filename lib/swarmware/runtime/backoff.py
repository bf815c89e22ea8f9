"""The one rule of a back-off: the pause before the next attempt grows with the failures in a row."""

from __future__ import annotations

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import TypeVar

    Pause = TypeVar("Pause", int, float)


def pause_after(failures: int, pauses: Sequence[Pause]) -> Pause:
    """Pause before the next attempt; `failures`: consecutive failures, at least one.

    Shapes: `pauses`: after the first, second, … failure; the last one from then on.
    """
    return pauses[min(failures, len(pauses)) - 1]
