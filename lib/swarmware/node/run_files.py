"""The files of a process in the run directory, which cleaners of temporary files may remove under it."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from swarmware.errors import SwarmError

TendFile = Callable[[], Path | None]
"""Makes one file again if it was removed or replaced; its path, or None if it stands. Raises: OSError,
SwarmError."""


class Damage(NamedTuple):
    """Files of this process that were removed or damaged by others."""

    repaired: tuple[str, ...]
    """Paths that were made again."""
    errors: tuple[str, ...]
    """Reasons for which others could not be made again."""


class RunFiles:
    """Files by which other processes find this one: its sockets, locks, doorbell and application files."""

    def __init__(self) -> None:
        self._tended: dict[TendFile, None] = {}

    def keep(self, tend: TendFile) -> None:
        """Check one more file, after those that were added before."""
        self._tended[tend] = None

    def release(self, tend: TendFile) -> None:
        """Check it no longer."""
        self._tended.pop(tend, None)

    def tend(self) -> tuple[list[str], list[str]]:
        """Make removed files again; their paths, and the errors of those that could not be made."""
        repaired, errors = [], []
        for tend in tuple(self._tended):
            try:
                if (path := tend()) is not None:
                    repaired.append(str(path))
            except (OSError, SwarmError) as error:
                errors.append(f"a file of this process was removed, and cannot be made again: {error}")
        return repaired, errors
