"""One direction of a link: what an operator has set on it, what has passed, and what was lost."""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Final

import msgspec

Chance = Callable[[], float]
"""Returns a random number from 0 up to 1."""

SHAPER_BYTES: Final = 64_000
"""Queue before a limited rate; longer ones add seconds of delay on slow links."""
DELAY_WEIGHT: Final = 0.05
"""Weight of one frame in the mean delay: about the last twenty."""


DELAY_MAX_S: Final = 60.0
RATE_MAX_BIT_S: Final = 1e11
LossRatio = Annotated[float, msgspec.Meta(ge=0, le=1)]
AddedDelay = Annotated[float, msgspec.Meta(ge=0, le=DELAY_MAX_S)]
RateLimit = Annotated[float, msgspec.Meta(ge=0, le=RATE_MAX_BIT_S)]


class Impairment(msgspec.Struct, frozen=True, kw_only=True):
    """What an operator has set on a link, in addition to what the radio does."""

    loss_ratio: LossRatio = 0.0
    """Loss of frames, after all repetitions of the radio."""
    delay_s: AddedDelay = 0.0
    jitter_s: AddedDelay = 0.0
    """Maximum random delay beside it, uniformly distributed; frames stay in order."""
    rate_bit_s: RateLimit = 0.0
    """Limit of the rate in bit/s, or 0 for no limit."""


class ImpairmentChange(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """New values of an impairment, each None to keep the former one."""

    loss_ratio: LossRatio | None = None
    delay_s: AddedDelay | None = None
    jitter_s: AddedDelay | None = None
    rate_bit_s: RateLimit | None = None
    """Limit of the rate in bit/s, or 0 for no limit."""

    @property
    def is_empty(self) -> bool:
        """Whether it changes nothing."""
        return self == ImpairmentChange()

    def applied(self, before: Impairment) -> Impairment:
        """The impairment with the new values."""
        new = {name: value for name in self.__struct_fields__ if (value := getattr(self, name)) is not None}
        return msgspec.structs.replace(before, **new)


class DropReason(StrEnum):
    """Why a frame did not arrive."""

    LOST = "lost"
    """The frame was lost by the radio or the impairment."""
    OUT_OF_RANGE = "out of range"
    CUT = "cut"
    QUEUE = "queue"
    """The transmit queue of the sender, or the queue of a limited rate, was full."""


class DirectedLink:
    """One direction of a link after the radio: cut, loss, rate, delay, and the counters of both."""

    def __init__(self, chance: Chance) -> None:
        self._chance = chance
        self._free_ns = 0
        """End of the transmissions at the limited rate."""
        self._last_ns = -1
        self.impairment = Impairment()
        self.is_cut = False
        self.frames = 0
        """Frames that arrived."""
        self.bytes = 0
        self.in_flight_bytes = 0
        """Bytes on the way to the receiver, those before a limited rate included."""
        self.mean_delay_s = 0.0
        """Mean time of the last frames from the sender to the receiver."""
        self.dropped = dict.fromkeys(DropReason, 0)

    def arrival_ns(self, size: int, at_ns: int) -> int | None:
        """Instant at which a frame that has left the radio arrives, or None if it is dropped."""
        set_ = self.impairment
        if self.is_cut:
            self.drop(DropReason.CUT)
            return None
        if set_.loss_ratio and self._chance() < set_.loss_ratio:
            self.drop(DropReason.LOST)
            return None
        if set_.rate_bit_s:
            waiting_ns = max(0, self._free_ns - at_ns)
            # the queue in bytes follows from the time that it needs at this rate
            if waiting_ns * set_.rate_bit_s / 8e9 + size > SHAPER_BYTES:
                self.drop(DropReason.QUEUE)
                return None
            at_ns += waiting_ns + round(size * 8e9 / set_.rate_bit_s)
            self._free_ns = at_ns
        delay_s = set_.delay_s + (set_.jitter_s * self._chance() if set_.jitter_s else 0.0)
        # later than the frame before it: jitter does not reorder
        self._last_ns = max(self._last_ns + 1, at_ns + round(delay_s * 1e9))
        self.in_flight_bytes += size
        return self._last_ns

    def arrive(self, size: int, delay_s: float) -> bool:
        """Counts a frame at its arrival; False when the link was cut while it was on the way."""
        self.in_flight_bytes -= size
        if self.is_cut:
            self.drop(DropReason.CUT)
            return False
        self.frames += 1
        self.bytes += size
        # the first frame sets the mean, which would otherwise rise from zero for many frames
        weight = DELAY_WEIGHT if self.frames > 1 else 1.0
        self.mean_delay_s += weight * (delay_s - self.mean_delay_s)
        return True

    def drop(self, reason: DropReason) -> None:
        """Counts a frame that does not arrive."""
        self.dropped[reason] += 1
