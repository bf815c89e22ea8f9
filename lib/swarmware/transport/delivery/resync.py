"""Order of a stream whose owner has snapshots of its state: after a gap a snapshot, then later items."""

from collections import deque
from typing import Final, Generic, TypeVar

T = TypeVar("T")

HELD_MAX: Final = 4096
"""Items that wait for a snapshot; the oldest are dropped, and a further snapshot is needed."""


class StreamResync(Generic[T]):
    """Decides which items of a stream follow each other, and when a snapshot must come first."""

    def __init__(self, held_max: int = HELD_MAX) -> None:
        self._held: deque[tuple[int, int, T]] = deque(maxlen=held_max)
        """Sequence, stamp and value of items that wait for a snapshot."""
        self._ready: deque[T] = deque()
        self._last: tuple[int, int] | None = None
        """Sequence and stamp of the newest item or snapshot that was passed on."""
        self.needs_snapshot = True
        """Whether a snapshot must be passed on next: at first, and after each gap."""
        self.gaps = 0
        """Items that did not arrive."""

    def on_item(self, sequence: int, stamp_ns: int, item: T) -> None:
        """An item of the owner arrived, with its sequence and stamp."""
        if self.needs_snapshot or self._last is None:
            self._held.append((sequence, stamp_ns, item))
            return
        last, last_ns = self._last
        if sequence == last + 1:
            self._last = sequence, stamp_ns
            self._ready.append(item)
        elif sequence > last + 1 or stamp_ns > last_ns:  # smaller, but later: a restarted owner
            self.gaps += max(0, sequence - last - 1)
            self.needs_snapshot = True
            self._held.append((sequence, stamp_ns, item))

    def on_snapshot(self, sequence: int, stamp_ns: int) -> bool:
        """Take the state after the item with this sequence; returns False if later items are missing, too."""
        held = [one for one in self._held if one[0] > sequence or one[1] > stamp_ns]
        if held and held[0][0] != sequence + 1:
            return False
        self._held.clear()
        self._last = sequence, stamp_ns
        self.needs_snapshot = False
        for one in held:
            self.on_item(*one)
        return True

    def take(self) -> T | None:
        """The next item in order, or None without an item, or if a snapshot comes first."""
        return self._ready.popleft() if self._ready else None
