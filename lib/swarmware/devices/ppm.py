"""Sum signal of radio-control receivers (PPM): each channel is an interval between two pulses."""

from collections import Counter
from typing import Final

from swarmware.devices.crsf import CHANNELS, RcChannels

CENTRE_US: Final = 1500.0
HALF_US: Final = 500.0
"""Interval of the centre of a channel, and its change to the end."""
_MIN_US: Final = 700.0
_MAX_US: Final = 2300.0
"""Intervals of a channel beyond its ends, which some transmitters use."""
_SYNC_US: Final = 2700.0
"""A longer interval is the pause before the first channel: at 22.5 ms with eight channels at least 4 ms."""
_CHANNELS_MIN: Final = 4
"""Fewer do not have four sticks."""


class PpmDecoder:
    """Decodes the instants of rising edges; `refused` counts refused frames by reason."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.valid = 0
        """Valid frames so far."""
        self._edge_ns: int | None = None
        self._widths_us: list[float] | None = None
        """Channels since the pause, or None while the next pause is awaited."""

    def edge(self, stamp_ns: int) -> RcChannels | None:
        """Takes an edge; the channels at the end of a frame, else None."""
        former, self._edge_ns = self._edge_ns, stamp_ns
        if former is None:
            return None
        width_us = (stamp_ns - former) / 1000
        if width_us >= _SYNC_US:
            found, self._widths_us = self._widths_us, []
            return None if found is None else self._frame(found)
        if self._widths_us is None:
            return None
        if not _MIN_US <= width_us <= _MAX_US or len(self._widths_us) == CHANNELS:
            self.refused[
                "interval out of range" if len(self._widths_us) < CHANNELS else "too many channels"
            ] += 1
            self._widths_us = None
            return None
        self._widths_us.append(width_us)
        return None

    def on_lost(self) -> None:
        """Edges were lost: the frame that is open has no meaning."""
        self.refused["edges lost"] += 1
        self._edge_ns = self._widths_us = None

    def _frame(self, widths_us: list[float]) -> RcChannels | None:
        if len(widths_us) < _CHANNELS_MIN:
            self.refused["too few channels"] += 1
            return None
        self.valid += 1
        positions = [min(max((width - CENTRE_US) / HALF_US, -1.0), 1.0) for width in widths_us]
        return RcChannels((*positions, *[0.0] * (CHANNELS - len(positions))))
