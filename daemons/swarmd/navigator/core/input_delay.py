"""Delays of the values of one input, from their stamps to their use, collected over a second."""

from typing import Final

from swarmware.types.placement import InputDelays

WINDOW_NS: Final = 1_000_000_000
VALUES_MAX: Final = 1000
"""Delays in one report; an input of a higher rate is sampled from its beginning."""


class DelayMeter:
    """Collects delays; each report covers the values since the one before."""

    def __init__(self) -> None:
        self._delays_ms: list[float] = []
        self._began_ns: int | None = None

    def on_value(self, stamp_ns: int | None, now_ns: int) -> None:
        """A value was used; `stamp_ns`: own clock at its stamp, or None if its clock is unknown."""
        if self._began_ns is None:
            self._began_ns = now_ns
        if stamp_ns is not None and len(self._delays_ms) < VALUES_MAX:
            self._delays_ms.append(round((now_ns - stamp_ns) / 1e6, 2))

    def take(self, now_ns: int) -> InputDelays | None:
        """The delays of the last second; None until it is over, or without a value."""
        if self._began_ns is None or now_ns - self._began_ns < WINDOW_NS or not self._delays_ms:
            return None
        delays_ms = tuple(self._delays_ms)
        self._delays_ms.clear()
        self._began_ns = now_ns
        return InputDelays(round(sum(delays_ms) / len(delays_ms), 2), max(delays_ms), delays_ms)
