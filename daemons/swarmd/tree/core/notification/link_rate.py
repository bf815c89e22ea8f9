"""The rate of a stream that follows its link: items are left out before they wait."""

from collections.abc import Sequence
from typing import Final

from swarmware.transport.delivery.bitrate_control import QUEUE_NS, BitrateControl
from swarmware.transport.retransmission.rtt import QueueDelay
from swarmware.types.tree_exchange import TreeItem

UNLIMITED_BIT_S: Final = 10_000_000_000
"""As good as no limit."""
MIN_BIT_S: Final = 1_000
STOP_NS: Final = 100_000_000
"""Delay of what is under way from which nothing more is sent: the control learns of a queue when something is
acknowledged, and a link that falls to a tenth of its rate acknowledges little."""
STOPPED_NS: Final = 1_000_000_000
"""A stopped stream still sends an item after this time if none waits, to measure the link."""
BURST_NS: Final = 40_000_000
"""Items of this time may come together: many streams are written in groups."""
FREE_NS: Final = 3_000_000_000
"""Time without a queue after which the limit ends; a link that is full shows one each second or two."""
BASE_NS: Final = 10_000_000_000
"""The minimum of the delay is taken over the present and the former interval of this length."""
NEWEST: Final = 3
"""Number of newest delays whose minimum shows the queue; single ones are late on links that lose packets."""
_NEVER_NS: Final = -(1 << 62)


class LinkRate:
    """Decides which items are sent, by the delay of acknowledgements above its minimum."""

    __slots__ = (
        "_admitted_ns", "_control", "_delay", "_due_ns", "_item_bits", "_queue_ns", "_under_way",
    )  # fmt: skip

    def __init__(self) -> None:
        self._control = BitrateControl(
            UNLIMITED_BIT_S, False, 0, begin_bit_s=UNLIMITED_BIT_S, min_bit_s=MIN_BIT_S
        )
        self._under_way: dict[int, int] = {}
        """Instant at which items were sent, by the number of their first one."""
        self._delay = QueueDelay(BASE_NS, NEWEST, 0)
        self._queue_ns = _NEVER_NS
        """When a queue was seen last."""
        self._due_ns = _NEVER_NS
        """When all that was admitted has been sent at the present rate."""
        self._admitted_ns = _NEVER_NS
        self._item_bits = 0

    @property
    def is_limited(self) -> bool:
        """Whether the link does not carry all."""
        return self._control.bit_s < UNLIMITED_BIT_S

    @property
    def rate_hz(self) -> float | None:
        """Items per second of the present size, or None if the link carries all."""
        return self._control.bit_s / self._item_bits if self.is_limited and self._item_bits else None

    @property
    def reason(self) -> str:
        """Why the rate was changed last."""
        return self._control.changes[-1].reason if self.is_limited else "the link carries all"

    def admits(self, item: TreeItem, waiting_ns: int | None) -> bool:
        """Whether an item that is written now is sent; `waiting_ns`: stamp of the oldest that waits."""
        now_ns, bits = item.stamp_ns, 8 * len(item.data)
        is_early = 0 <= now_ns - self._admitted_ns < STOPPED_NS
        if self._is_stopped(now_ns, waiting_ns) and (waiting_ns is not None or is_early):
            return False
        self._item_bits = bits
        period_ns = self._period_ns
        # a bucket: what is ahead of the clock has been admitted, but not sent at this rate
        ahead_ns = self._due_ns - now_ns
        if ahead_ns > max(period_ns, STOPPED_NS):
            ahead_ns = 0  # the clock was set back, or items were far larger before
        if ahead_ns > BURST_NS:
            return False
        self._due_ns = now_ns + max(0, ahead_ns) + period_ns
        self._admitted_ns = now_ns
        return True

    @property
    def _period_ns(self) -> int:
        """Time that the link needs for an item at the present rate; its delay alone is not a queue."""
        return round(self._item_bits * 1e9 / self._control.bit_s)

    def _is_stopped(self, now_ns: int, waiting_ns: int | None) -> bool:
        latest_ns = now_ns - STOP_NS - self._period_ns
        oldest_ns = next(iter(self._under_way.values()), None)
        # the delay of the empty link does not come from a queue
        if oldest_ns is not None and oldest_ns < latest_ns - (self._delay.minimum_ns or 0):
            return True
        return waiting_ns is not None and waiting_ns < latest_ns

    def on_sent(self, items: Sequence[TreeItem], now_ns: int) -> None:
        """Items were handed to the link."""
        if items:
            self._under_way[items[0].sequence] = now_ns

    def on_returned(self, items: Sequence[TreeItem]) -> None:
        """Items were not delivered, and wait again."""
        if items:
            self._under_way.pop(items[0].sequence, None)

    def on_acknowledged(self, items: Sequence[TreeItem], waiting_ns: int | None, now_ns: int) -> None:
        """Items that were sent have arrived."""
        sent_ns = self._under_way.pop(items[0].sequence, None) if items else None
        if sent_ns is None:
            return
        # from the first sending on: copies of a lost one do not shorten the delay
        self._delay.add(now_ns - sent_ns, now_ns)
        self._control.on_received(sum(len(item.data) for item in items), now_ns)
        period_ns = self._period_ns
        queueing_ns = max(0, self._delay.queueing_ns - period_ns)
        waited_ns = 0 if waiting_ns is None else max(0, now_ns - waiting_ns - period_ns)
        if max(queueing_ns, waited_ns) > QUEUE_NS:
            self._queue_ns = now_ns
        # else a limit that was once set would grow only slowly on a link that is free
        if self.is_limited and now_ns - self._queue_ns > FREE_NS:
            self._control.on_free(now_ns)
        else:
            self._control.on_queue(queueing_ns, waited_ns, now_ns)
