"""Rate of a resource, from two of its values."""

from typing import Final

SILENCE: Final = 2.0
"""Periods without a value from which the silence counts, too."""


def measured_hz(values: int, span_s: float, age_s: float | None) -> float | None:
    """Rate of a resource of which `values` were written within `span_s` after an older one.

    `age_s`: time since the newest; when it exceeds the usual period the rate falls towards 0. None: no rate.
    """
    if values <= 0 or span_s <= 0:
        return None
    period_s = span_s / values
    if age_s is not None and age_s > SILENCE * period_s:
        span_s += age_s
    return values / span_s
