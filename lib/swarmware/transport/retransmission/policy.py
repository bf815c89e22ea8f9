"""The parameters in which one use of retransmission differs from another."""

from math import inf
from typing import Final

import msgspec

UNLIMITED: Final = 1 << 62


class RetransmissionPolicy(msgspec.Struct, frozen=True):
    """Window, time-outs, back-off and loss detection of one mechanism.

    By default the window is unlimited. Losses among numbered packets are detected as in RFC 9002, section 6.
    """

    window_first: float = inf
    """Window at first, in the unit of the sizes that the mechanism states: bytes, or 1 for each item."""
    window_min: float = inf
    window_max: float = inf
    window_growth: float = 0.0
    """Share of the size of an acknowledged item by which the window grows; each failure halves it."""
    count_max: int = UNLIMITED
    """Maximum unacknowledged items."""
    ignores_single_losses: bool = False
    """True if a failure counts only when no later item was acknowledged, and once in a back-off."""
    keeps_backoff: bool = False
    """True if an acknowledgement does not end the back-off."""

    initial_ns: int = 0
    """Retransmission time-out before the first measured round trip."""
    min_ns: int = 0
    max_ns: int = UNLIMITED
    granularity_ns: int = 0
    """Minimum of the margin above the smoothed round trip, and of the wait for an overtaken packet."""

    packet_threshold: int = 3
    """Higher numbers that arrive before a packet counts as lost."""
    packet_threshold_max: int = 64
    """Limit to which the threshold doubles when lost packets arrive after all."""
    time_ratio: float = 9 / 8
    """Round trips after which an overtaken packet counts as lost."""
    time_ratio_max: float = 3.0
    time_relaxation: float = 0.01
    """Share of its excess by which the ratio falls with each acknowledgement."""
    ack_delay_ns: int = 0
    """Longest delay of an acknowledgement that is not part of the round trip."""
    slack_ns: int = 0
    """Margin of a probe, within which the acknowledgement of the next packet may arrive instead."""
    urgent_slack_ns: int = 0
    """Margin of a probe where an urgent packet is in flight."""
    urgent_probes: int = 0
    """Probes for an urgent packet before their time-out doubles."""
    doublings_max: int = 0
    """Doublings of the time-out of a probe."""
    lost_kept: int = 512
    """Lost packets that are remembered, to recognise a late one."""
