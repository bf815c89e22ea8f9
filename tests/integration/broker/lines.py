"""A serial line between two nodes: two pseudo-terminals, whose bytes pass from one to the other."""

import asyncio
import contextlib
from pathlib import Path

from swarmware.runtime.pseudo_terminal import PseudoTerminal


class Line:
    """Two ends of a line, as device files; its bytes are counted, and may be damaged or cut."""

    def __init__(self, folder: Path) -> None:
        self.devices = (folder / "line-a", folder / "line-b")
        self.bytes: list[tuple[float, int]] = []
        """Instant and number of the bytes that the first end wrote."""
        self.is_cut = False
        """Nothing passes from the first end to the second one."""
        self._returns = True
        self._ends: list[PseudoTerminal] = []
        self.plug()

    def plug(self) -> None:
        """Makes both ends."""
        self._ends = [
            PseudoTerminal(self.devices[0], self._from_first),
            PseudoTerminal(self.devices[1], self._from_second),
        ]

    def unplug(self) -> None:
        """Removes both ends."""
        while self._ends:
            self._ends.pop().close()

    def cut(self) -> None:
        """Nothing passes in either direction; both ends stay."""
        self.is_cut, self._returns = True, False

    def heal(self) -> None:
        """Bytes pass in both directions again."""
        self.is_cut, self._returns = False, True

    def disturb(self, data: bytes) -> None:
        """Noise arrives at the second end."""
        self._ends[1].write(data)

    def _from_first(self, data: bytes) -> None:
        self.bytes.append((asyncio.get_running_loop().time(), len(data)))
        if not self.is_cut and self._ends:
            self._ends[1].write(data)

    def _from_second(self, data: bytes) -> None:
        if self._returns and self._ends:
            self._ends[0].write(data)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.unplug()
