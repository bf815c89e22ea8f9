"""How often a node ticks: as often as somebody needs it, never more than the air carries."""

from typing import Final

IDLE_HZ: Final = 2.0
"""A node of which nobody wants anything periodic."""
LEAST_HZ: Final = 1.0
AIRTIME: Final = 0.25
"""Share of the air that all ticks in hearing range may take."""
_FRAME_S: Final = 173e-6
_BYTE_S: Final = 1.333e-6
"""OFDM at the 6 Mb/s basic rate of multicast, DIFS, backoff and preamble; fits 180 B in 413 µs and
600 B in 973 µs of the scale study, section 1.3."""


def airtime_s(datagram_bytes: float) -> float:
    """Time that one multicast datagram takes on the air, IP header included."""
    return _FRAME_S + _BYTE_S * datagram_bytes


def tick_hz(wanted_hz: float, heard: int, datagram_bytes: float) -> float:
    """Tick rate among so many others in hearing range, after ETSI's decentralised congestion control."""
    allowed_hz = AIRTIME / ((heard + 1) * airtime_s(datagram_bytes))
    return max(min(wanted_hz, allowed_hz), LEAST_HZ)
