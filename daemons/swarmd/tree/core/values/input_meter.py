"""Values that arrive from the other computers of a platform, counted while a request measures them."""

from collections.abc import Callable, Iterable

from swarmware.model.names import Address
from swarmware.types.tree_exchange import TreeItem


class InputCount:
    """Values of one resource of one computer in the window."""

    __slots__ = ("delays_ns", "payload_bytes", "values")

    def __init__(self) -> None:
        self.values = 0
        self.payload_bytes = 0
        self.delays_ns: list[int] = []
        """Known delays of the values."""

    def add(self, size: int, delay_ns: int | None) -> None:
        """A value has arrived; without a delay its clock is unknown."""
        self.values += 1
        self.payload_bytes += size
        if delay_ns is not None:
            self.delays_ns.append(delay_ns)

    @property
    def mean_ms(self) -> float | None:
        """Mean delay, or None if no delay is known."""
        return sum(self.delays_ns) / len(self.delays_ns) / 1e6 if self.delays_ns else None

    def quantile_ms(self, ratio: float) -> float | None:
        """Delay that this share of the values did not exceed, or None if no delay is known."""
        ordered = sorted(self.delays_ns)
        return ordered[int(ratio * (len(ordered) - 1))] / 1e6 if ordered else None


class InputMeter:
    """Counts the values of the other computers of the own platform, with their delays."""

    def __init__(self, own: Address, to_local_ns: Callable[[int, int], int | None]) -> None:
        """`to_local_ns`: own clock at a stamp of another computer, by its hardware id."""
        self._own = own
        self._to_local_ns = to_local_ns
        self.counts: dict[tuple[str, str], InputCount] = {}
        """By unit and local path."""

    def on_items(self, sender: str, hardware: int, items: Iterable[TreeItem], now_ns: int) -> None:
        """Values of a node have arrived; values of other platforms are not counted."""
        address = Address.parse(sender)
        if address.platform != self._own.platform:
            return
        for item in items:
            stamp_ns = self._to_local_ns(hardware, item.stamp_ns)
            # the conversion of a clock has an error, which may exceed a short delay
            delay_ns = None if stamp_ns is None else max(0, now_ns - stamp_ns)
            self.counts.setdefault((address.unit, item.path), InputCount()).add(len(item.data), delay_ns)
