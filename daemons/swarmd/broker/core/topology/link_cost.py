"""The cost of a link: what a hop over it adds to the metric of a route."""

from typing import Final

PERFECT: Final = 256
"""Cost of a link without loss."""
COST_MAX: Final = 16384
RTT_FREE_NS: Final = 10_000_000
RTT_FULL_NS: Final = 120_000_000
RTT_PENALTY: Final = 96
"""A round trip above the first time adds to the cost, up to this at the second one: babeld's `rtt-min`,
`rtt-max` and `max-rtt-penalty`. A full queue alone never turns a route: its hysteresis is as large."""
_RTT_STEPS: Final = 3
_FULL: Final = 255


def link_cost(quality: int, reported: int, penalty: int, rtt_ns: int) -> int:
    """Square of the expected transmissions, in 1/256, and what a slow medium or a long round trip adds.

    `quality`, `reported`: share that arrives here and there, in 1/255; `penalty`: of the medium. The square
    keeps routes off links at the edge of their range, which end before a moving swarm has turned its routes:
    of 100 nodes at 10 m/s 99.8 % of the pairs have their route, with the plain number 99.2 %, for fewer bytes
    (test_routes_at_speed).
    """
    both = quality * reported
    if not both:
        return COST_MAX
    return min(PERFECT * _FULL**4 // both**2 + penalty + rtt_penalty(rtt_ns), COST_MAX)


def rtt_penalty(rtt_ns: int) -> int:
    """Cost of the round trip, in steps that its scatter does not pass."""
    if rtt_ns <= RTT_FREE_NS:
        return 0
    ratio = min((rtt_ns - RTT_FREE_NS) / (RTT_FULL_NS - RTT_FREE_NS), 1.0)
    return round(ratio * _RTT_STEPS) * (RTT_PENALTY // _RTT_STEPS)
