"""Scales of charts: from values to pixels, with ticks at round values."""

import math
from typing import Final

import msgspec

_STEPS: Final = (1.0, 2.0, 5.0, 10.0)


class Scale(msgspec.Struct, frozen=True):
    """A linear or logarithmic axis; the page states which one."""

    low: float
    high: float
    start_px: float
    end_px: float
    log: bool = False

    def px(self, value: float) -> float:
        """Pixel of a value; values beyond an end of the axis are drawn at that end."""
        value = min(max(value, self.low), self.high)
        if self.log:
            ratio = math.log(value / self.low) / math.log(self.high / self.low)
        else:
            ratio = (value - self.low) / (self.high - self.low)
        return self.start_px + ratio * (self.end_px - self.start_px)

    def ticks(self, count: int = 6) -> list[float]:
        """About `count` round values; on a logarithmic axis powers of ten, and 2 and 5 times them."""
        if self.log:
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            found = [step * 10.0**power for power in decades for step in _STEPS[:-1]]
            inside = [
                value for value in found if self.low <= value * (1 + 1e-9) and value <= self.high * (1 + 1e-9)
            ]
            tens = [
                value for value in inside if math.isclose(math.log10(value) % 1.0 % 1.0, 0.0, abs_tol=1e-6)
            ]
            # powers of ten alone where the others would be too dense
            return tens if len(inside) > 2 * count and len(tens) > 1 else inside
        step = round_step((self.high - self.low) / count)
        # the small numbers keep a tick at an end of the axis despite rounding
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [number * step for number in range(first, last + 1)]


def round_step(at_least: float) -> float:
    """The smallest of 1, 2, 5 × 10ⁿ that is not below a positive value."""
    power = 10.0 ** math.floor(math.log10(at_least))
    return next(step * power for step in _STEPS if step * power >= at_least * (1 - 1e-9))


def round_top(value: float, count: int = 6) -> float:
    """The end of a linear axis from 0 that contains a value, at a tick."""
    if value <= 0:
        return 1.0
    step = round_step(value / count)
    return math.ceil(value / step - 1e-9) * step


def label(value: float) -> str:
    """Text of a tick."""
    return f"{value:.10g}"
