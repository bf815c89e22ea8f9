"""Items that were lost on the way from another platform, by the gaps in the sequence of their owner."""


class SequenceGaps:
    """Counts the items that are missing between those that arrive."""

    def __init__(self) -> None:
        self.lost = 0
        self._last: tuple[int, int] | None = None
        """Owner's sequence and stamp of the newest item."""

    def on_item(self, sequence: int, stamp_ns: int) -> None:
        """The next item has arrived; a smaller sequence means a restart of the owner."""
        if self._last is not None:
            last, last_ns = self._last
            if sequence > last + 1 and stamp_ns >= last_ns:
                self.lost += sequence - last - 1
        self._last = sequence, stamp_ns
