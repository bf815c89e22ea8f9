"""Meter of the delays of an input's values, from their stamps to their use."""

from typing import Final

from swarmware.types.placement import InputDelays

WINDOW_NS: Final = 1_000_000_000
VALUES_MAX: Final = 1000
"""Maximum number of delays in a report; of an input with a higher rate the first values are reported."""


class DelayMeter:
    """Collects delays; each report covers the values since the previous report."""

    def __init__(self) -> None:
        self._delays_ms: list[float] = []
        self._began_ns: int | None = None

    def on_value(self, stamp_ns: int | None, now_ns: int) -> None:
        """Takes the use of a value; `stamp_ns`: stamp in the own clock, or None if the sender's clock is
        unknown."""
        if self._began_ns is None:
            self._began_ns = now_ns
        if stamp_ns is not None and len(self._delays_ms) < VALUES_MAX:
            self._delays_ms.append(round((now_ns - stamp_ns) / 1e6, 2))

    def take(self, now_ns: int) -> InputDelays | None:
        """Delays of the last second, or None before its end and without a value."""
        if self._began_ns is None or now_ns - self._began_ns < WINDOW_NS or not self._delays_ms:
            return None
        delays_ms = tuple(self._delays_ms)
        self._delays_ms.clear()
        self._began_ns = now_ns
        return InputDelays(round(sum(delays_ms) / len(delays_ms), 2), max(delays_ms), delays_ms)
