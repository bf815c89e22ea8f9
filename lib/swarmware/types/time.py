"""Clock-conversion functions: clocks are never adjusted, stamps are converted (S1.61, S1.64)."""

import math
from enum import StrEnum
from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model import names
from swarmware.types.bounds import Count, Instant, Uint32
from swarmware.types.registry import register

AGEING: Final = 5.196e-8
"""Drift slack in s per s^1.5: 3·q/√3, three standard deviations of a clock whose rate walks at random by
q = 0.03 ppm/√s."""

LIKELY_SIGMAS: Final = 8.0
"""Standard deviations that held 99.9 % of the errors of simulated chains of one to ten links: the errors of
a link have heavier tails than a normal distribution, of which four would do."""


SKEW_LIMIT: Final = 0.01
"""Maximum skew of a working clock: quartz has at most 1e-4, simulated clocks more."""

LINK_SKEW_LIMIT: Final = 1e-3
"""Skew over one link of which no oscillator is capable: quartz keeps ±100 ppm, the lab simulates ±500."""

HOPS_LIMIT: Final = 24
"""Maximum links of a composition, more than the diameter of any simulated swarm: it ends a loop."""

INSTANT_LIMIT_NS: Final = 1 << 61
"""73 years: no clock reading, offset or bound is larger, and sums of two still fit 64 bits."""

FUNCTIONS_LIMIT: Final = 4096
"""Functions in one list: more come from no configuration."""


class Order(StrEnum):
    """Order of two instants."""

    BEFORE = "before"
    AFTER = "after"
    UNDECIDED = "undecided"


@register
class Conversion(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The clock of another hardware unit as a function of this unit's clock.

    remote(t) = t + offset_ns + skew · (t − t0_ns), with t on the local clock.
    """

    platform: str
    """Platform of the clock."""
    unit: str
    hardware: int
    """`names.hardware_id(platform, unit)`."""
    boot_id: int
    """Boot of that unit for which this holds; another boot is another clock."""
    offset_ns: Instant
    """Remote minus local at t0: positive when theirs is ahead."""
    skew: Annotated[float, msgspec.Meta(ge=-SKEW_LIMIT, le=SKEW_LIMIT)]
    """Relative rate of their clock minus 1, as a ratio: 1e-6 is one ppm."""
    t0_ns: Instant
    """Local instant for which the offset was estimated."""
    bound_ns: Count
    """Hard bound of the error at t0; always holds, also for asymmetric links."""
    sigma_ns: Count
    """Statistical error at t0."""
    skew_bound: Annotated[float, msgspec.Meta(ge=0, le=SKEW_LIMIT)]
    """Hard bound of the skew's error, as a ratio: how the bound grows away from t0."""
    conv_epoch: Uint32
    """Counts the steps of either clock; functions of different epochs must not be mixed."""
    hops: int = 1
    """Number of links over which it was composed; 1 if it was measured directly."""
    via: str = ""
    """Node over which it was composed, or "" if measured directly."""
    samples: int = 0
    """Exchanges of its estimation; an initial value from a partner has none."""
    rtt_ns: int = 0
    """Smallest round trip of the last one or two windows, with the error of the skew, or 0 if composed or
    before the first measurement."""
    suspect: bool = False
    """True if a partner's function contradicts it beyond both bounds (S1.70)."""

    def plausible(self) -> bool:
        """Whether two real clocks can have this relation: all numbers finite and in range."""
        try:
            names.check_platform(self.platform)
            names.check_platform(self.unit)
            if self.via:
                names.Address.parse(self.via)
        except InvalidInput:
            return False
        limit = min(LINK_SKEW_LIMIT * self.hops, SKEW_LIMIT)
        return (
            1 <= self.hops <= HOPS_LIMIT
            and abs(self.skew) <= limit
            and 0.0 <= self.skew_bound <= limit
            and abs(self.offset_ns) < INSTANT_LIMIT_NS
            and abs(self.t0_ns) < INSTANT_LIMIT_NS
            and 0 <= self.bound_ns < INSTANT_LIMIT_NS
            and 0 <= self.sigma_ns < INSTANT_LIMIT_NS
            and 0 <= self.rtt_ns < INSTANT_LIMIT_NS
            and 0 <= self.samples < INSTANT_LIMIT_NS
            and 0 <= self.hardware <= names.ANY
            and 0 <= self.conv_epoch <= 0xFFFF_FFFF
            and 0 <= self.boot_id < 1 << 64
        )

    def to_remote(self, local_ns: int) -> int:
        """Reading of the other clock at an instant of our clock."""
        return local_ns + self.offset_ns + round(self.skew * (local_ns - self.t0_ns))

    def to_local(self, remote_ns: int) -> int:
        """Our clock's reading at an instant of theirs."""
        since_ns = remote_ns - self.offset_ns - self.t0_ns
        return self.t0_ns + since_ns - round(since_ns * self.skew / (1.0 + self.skew))

    def age_s(self, now_ns: int) -> float:
        """Time since the newest exchange of its estimation."""
        return max(0.0, (now_ns - self.t0_ns) / 1e9)

    def bound_at_ns(self, local_ns: int) -> int:
        """Hard bound of the error at any instant of our clock: it grows away from t0."""
        away_s = abs(local_ns - self.t0_ns) / 1e9
        return self.bound_ns + round((self.skew_bound * away_s + AGEING * away_s * math.sqrt(away_s)) * 1e9)

    def agrees(self, other: "Conversion", local_ns: int) -> bool:
        """Whether both can hold for the same clock at an instant of our clock."""
        apart_ns = abs(self.to_remote(local_ns) - other.to_remote(local_ns))
        return apart_ns <= self.bound_at_ns(local_ns) + other.bound_at_ns(local_ns)

    def likely_at_ns(self, local_ns: int) -> int:
        """Bound that 99.9 % of errors keep on links without a constant asymmetry."""
        away_s = abs(local_ns - self.t0_ns) / 1e9
        grown_ns = (self.skew_bound / 4 * away_s + AGEING * away_s * math.sqrt(away_s)) * 1e9
        return min(round(LIKELY_SIGMAS * self.sigma_ns + grown_ns), self.bound_at_ns(local_ns))

    def interval(self, remote_ns: int) -> tuple[int, int]:
        """Earliest and latest instant of our clock that their stamp can mean."""
        local_ns = self.to_local(remote_ns)
        bound_ns = self.bound_at_ns(local_ns)
        return local_ns - bound_ns, local_ns + bound_ns

    def inverse(self, platform: str, unit: str, hardware: int, boot_id: int) -> "Conversion":
        """The inverse relation: our clock, of the unit named, as a function of theirs."""
        return msgspec.structs.replace(
            self,
            platform=platform,
            unit=unit,
            hardware=hardware,
            boot_id=boot_id,
            offset_ns=-self.offset_ns,
            skew=-self.skew / (1.0 + self.skew),
            t0_ns=self.t0_ns + self.offset_ns,
        )

    def then(self, further: "Conversion", via: str) -> "Conversion":
        """Composition over a further hop: `self` is ours → via, `further` is via → the unit of the result.

        Offsets add at the converted instant, rates multiply, bounds add, variances add.
        """
        # The older of the two: a composed function must not look fresher than its oldest link.
        at_ns = min(self.t0_ns, self.to_local(further.t0_ns))
        via_ns = self.to_remote(at_ns)
        return Conversion(
            platform=further.platform,
            unit=further.unit,
            hardware=further.hardware,
            boot_id=further.boot_id,
            offset_ns=further.to_remote(via_ns) - at_ns,
            skew=(1.0 + self.skew) * (1.0 + further.skew) - 1.0,
            t0_ns=at_ns,
            bound_ns=self.bound_at_ns(at_ns) + further.bound_at_ns(via_ns),
            sigma_ns=round(math.hypot(self.sigma_at_ns(at_ns), further.sigma_at_ns(via_ns))),
            skew_bound=self.skew_bound + further.skew_bound,
            conv_epoch=(self.conv_epoch + further.conv_epoch) & 0xFFFF_FFFF,
            hops=self.hops + further.hops,
            via=via,
            samples=min(self.samples, further.samples),
            suspect=self.suspect or further.suspect,
        )

    def sigma_at_ns(self, local_ns: int) -> int:
        """Statistical error at any instant of our clock."""
        away_s = abs(local_ns - self.t0_ns) / 1e9
        return round(math.hypot(self.sigma_ns, self.skew_bound / 8 * away_s * 1e9))


def compare(a_ns: int, a: Conversion | None, b_ns: int, b: Conversion | None) -> Order:
    """Order of two stamps, each with the conversion of the clock that made it.

    None means our own clock. When the bounds overlap, the result is UNDECIDED; two stamps of one
    clock always compare exactly.
    """
    same = a is b or (a is not None and b is not None and (a.hardware, a.boot_id) == (b.hardware, b.boot_id))
    if same:
        earliest_a = latest_a = a_ns
        earliest_b = latest_b = b_ns
    else:
        earliest_a, latest_a = (a_ns, a_ns) if a is None else a.interval(a_ns)
        earliest_b, latest_b = (b_ns, b_ns) if b is None else b.interval(b_ns)
    if latest_a < earliest_b:
        return Order.BEFORE
    if latest_b < earliest_a:
        return Order.AFTER
    return Order.UNDECIDED


@register
class TimeFunctions(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All conversion functions of one hardware unit, sorted by hardware unit (S1.69)."""

    platform: str
    """Platform of the functions: their `local` is this unit's clock."""
    unit: str
    boot_id: int
    stamp_ns: Instant
    """Clock of the unit when the list was made."""
    functions: tuple[Conversion, ...] = ()

    def of(self, platform: str, unit: str = "main") -> Conversion | None:
        """The function of one unit, or None if it is unknown."""
        for function in self.functions:
            if function.platform == platform and function.unit == unit:
                return function
        return None


@register
class TimingSample(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Clock differences measured from one datagram, theirs minus ours."""

    platform: str
    unit: str
    hardware: int
    boot_id: int
    """Start of their clock; a changed value means a new clock."""
    received_ns: Instant
    """Reading of our clock at the arrival of the datagram."""
    lower_ns: Instant
    """Lower bound of the offset of the other clock, its send time minus our receive time."""
    sent_ns: Instant = 0
    """Reading of our clock when the echoed datagram left."""
    upper_ns: Instant | None = None
    """Upper bound of the offset, its receive time minus our send time of the echoed datagram, or None without
    an echo."""


@register
class TimingBatch(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All clock differences since the last beacon (stream `net/timing`)."""

    samples: tuple[TimingSample, ...]
