"""The link to one neighbour over one medium: loss in both directions, and whether each is alive."""

from typing import Final

from swarmd.broker.core.beacon.beacon import NEVER_NS
from swarmd.broker.core.swarm.media.arrivals import Arrivals
from swarmd.broker.core.swarm.media.medium import COST_MAX, PERFECT, Address, MediumProfile

PERIODS: Final = 2.5
"""Periods without a beacon after which a medium without loss is silent: one beacon may be lost."""
PERIODS_MAX: Final = 6.0
"""Periods without a beacon after which a lossy medium is silent: at a loss of 30 % six losses in a row happen
once in a thousand beacons."""
LISTINGS: Final = 5
"""Listings without an answer about this medium after which the neighbour does not receive by it."""
_FULL: Final = 255


class MediumLink:
    """The link to one neighbour over one medium."""

    __slots__ = (
        "_arrivals",
        "_listed_ns",
        "_period_ns",
        "_received_ns",
        "_reported",
        "_timeout_ns",
        "address",
        "frames_ns",
        "medium",
    )

    def __init__(self, medium: MediumProfile, timeout_ns: int) -> None:
        self.medium = medium
        self.address: Address = ("", 0)
        """Source address of its datagrams."""
        self.frames_ns = NEVER_NS
        """Instant of its last packet with frames."""
        self._timeout_ns = timeout_ns
        self._arrivals = Arrivals()
        self._received_ns = NEVER_NS
        self._period_ns = 0
        self._reported = 0
        self._listed_ns = NEVER_NS

    def on_arrival(self, number: int, address: Address, period_ns: int, now_ns: int) -> None:
        """A datagram of the neighbour's session arrived; `period_ns`: between two of them, as it declares."""
        if not self.is_received(now_ns):
            self._arrivals = Arrivals()
        self._arrivals.on_number(number)
        self.address = address
        self._period_ns = period_ns
        self._received_ns = now_ns

    def on_listed(self, quality: int, now_ns: int) -> None:
        """The neighbour says what share of our datagrams reaches it by this medium, in 1/255."""
        self._reported = quality
        self._listed_ns = now_ns

    @property
    def deadline_ns(self) -> int:
        """When the medium is silent, unless a datagram arrives."""
        lossy = PERIODS * (_FULL / max(self._arrivals.quality, 1)) ** 2
        periods = min(lossy, PERIODS_MAX)
        return self._received_ns + max(self._timeout_ns, round(periods * self._period_ns))

    def is_received(self, now_ns: int) -> bool:
        """Whether datagrams of the neighbour arrive."""
        return now_ns < self.deadline_ns

    def is_up(self, now_ns: int) -> bool:
        """Whether both directions work."""
        return self.is_received(now_ns) and self.quality_out(now_ns) > 0

    def quality_in(self, now_ns: int) -> int:
        """Share of the neighbour's datagrams that arrive here, in 1/255."""
        return self._arrivals.quality if self.is_received(now_ns) else 0

    def quality_out(self, now_ns: int) -> int:
        """Share of our datagrams that arrive there, or 0 without a recent report of the neighbour."""
        silence_ns = LISTINGS * max(self._period_ns, self._timeout_ns // 2)
        return self._reported if now_ns - self._listed_ns <= silence_ns else 0

    def silent_ns(self, now_ns: int) -> int:
        """Time since its last datagram."""
        return now_ns - self._received_ns

    def cost_out(self, now_ns: int) -> int:
        """Cost of sending to the neighbour by this medium: transmissions, and the time that they take."""
        quality = self.quality_out(now_ns)
        if not quality:
            return COST_MAX
        return min(PERFECT * _FULL**2 // quality**2 + self.medium.rate_penalty, COST_MAX)
