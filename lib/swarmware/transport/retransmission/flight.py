"""Items in flight: sent and not acknowledged, within a window that successes widen and failures halve."""

from collections.abc import Hashable, Iterator, Sequence
from typing import Generic, TypeVar

import msgspec

from swarmware.runtime.backoff import pause_after
from swarmware.transport.retransmission.policy import RetransmissionPolicy


class Sent(msgspec.Struct, kw_only=True):
    """An item in flight; a mechanism adds its own fields."""

    sent_ns: int
    """Instant of the newest transmission."""
    size: int = 1
    times_sent: int = 1
    is_lost: bool = False
    """True from a failure to the retransmission."""

    def round_trip_ns(self, now_ns: int) -> int | None:
        """Round trip of an item acknowledged now, or None after a retransmission.

        The acknowledged copy is then unknown. Source: RFC 6298, section 3 (Karn's algorithm).
        """
        return now_ns - self.sent_ns if self.times_sent == 1 else None


Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item", bound=Sent)


class Flight(Generic[Key, Item]):
    """The items in flight in the order of their first transmission, their window and their back-off."""

    def __init__(self, policy: RetransmissionPolicy) -> None:
        self._policy = policy
        self._items: dict[Key, Item] = {}
        self._size = 0
        self._window = policy.window_first
        self.sent_ns = 0
        """Instant of the newest first transmission."""
        self.arrived_ns = -(1 << 62)
        """Instant of the last acknowledgement, or less than 0 before the first one."""
        self.failures = 0
        """Consecutive failures, as far as they count."""
        self.backoff_until_ns = 0
        """End of the back-off after a failure."""
        self.failing_since_ns: int | None = None
        """First failure since the last acknowledgement, or None without one."""

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Item]:
        return iter(self._items.values())

    def get(self, key: Key) -> Item | None:
        """The item in flight with this key."""
        return self._items.get(key)

    def has_room(self, size: int = 1) -> bool:
        """Whether the window has room for another item; one is always sent."""
        if not self._items:
            return True
        return len(self._items) < self._policy.count_max and self._size + size <= self._window

    def add(self, key: Key, item: Item) -> None:
        """The item is sent for the first time."""
        self._items[key] = item
        self.sent_ns = item.sent_ns
        self._size += item.size

    def acknowledge(self, key: Key, now_ns: int) -> Item | None:
        """The item has arrived; returns None for a key that is not in flight, such as a duplicate's."""
        item = self.drop(key)
        if item is not None:
            self.arrived_ns = now_ns
            self._window = min(self._window + self._policy.window_growth * item.size, self._policy.window_max)
            if not self._policy.keeps_backoff:
                self.reset_backoff()
        return item

    def fail(self, key: Key, now_ns: int, pauses_ns: Sequence[int] = (0,)) -> Item | None:
        """The item was not acknowledged in time; returns None if it is not in flight, or is lost already.

        Shapes: `pauses_ns`: back-off after the first, second, … consecutive failure.
        """
        item = self._items.get(key)
        if item is None or item.is_lost:
            return None
        item.is_lost = True
        if self.failing_since_ns is None:
            self.failing_since_ns = now_ns
        # If a later one has arrived since, only this one was lost, and the way has not become slower.
        is_single = item.sent_ns < self.arrived_ns or now_ns < self.backoff_until_ns
        if not (is_single and self._policy.ignores_single_losses):
            self._window = max(self._window / 2, self._policy.window_min)
            self.failures += 1
            self.backoff_until_ns = now_ns + pause_after(self.failures, pauses_ns)
        return item

    def resize(self, item: Item, size: int) -> None:
        """The next transmission of the item has another size."""
        self._size += size - item.size
        item.size = size

    def resend(self, key: Key, now_ns: int) -> Item:
        """The item is sent again."""
        item = self._items[key]
        item.sent_ns = now_ns
        item.times_sent += 1
        item.is_lost = False
        return item

    def repeatable(self) -> list[Key]:
        """Keys of the oldest lost items, as many as the window permits.

        All of them at once would fail again on a slow link, for ever.
        """
        found: list[Key] = []
        size = sum(item.size for item in self if not item.is_lost)
        for key, item in self._items.items():
            if item.is_lost and (not size or size + item.size <= self._window):
                size += item.size
                found.append(key)
            elif item.is_lost:
                break
        return found

    def drop(self, key: Key) -> Item | None:
        """Remove an item that is neither acknowledged nor sent again."""
        item = self._items.pop(key, None)
        if item is not None:
            self._size -= item.size
        return item

    def reset_backoff(self) -> None:
        """The receiver is reachable: end the back-off."""
        self.backoff_until_ns = self.failures = 0
        self.failing_since_ns = None

    def clear(self) -> None:
        """Remove all items and end the back-off."""
        self._items.clear()
        self._size = 0
        self.reset_backoff()
