"""When a silent neighbour is asked for a beacon, and how many requests without an answer take its link down.

A node at rest sends two beacons a second: three missing ones are more than a second and a half. A neighbour
that knows the request answers it within a tenth of a second: a few without an answer say as much, sooner.

Source: RFC 4861, section 7.3 (neighbour unreachability detection).
"""

import math
from functools import lru_cache
from typing import Final

ASK_AGAIN_NS: Final = 70_000_000
"""Time between two requests; with the random delay of triggered beacons 10 in a second."""
ASKS_MIN: Final = 2
"""Requests without an answer that take a link without loss down: one request or answer may be lost."""
ASKS_MAX: Final = 10
SUSPICION: Final = 0.07
"""Share of the periods of a node in which it asks in vain, for all neighbours together: each time costs about
two beacons."""
LOSS_MIN: Final = 1 / 256
"""Assumed loss of a link that has lost nothing lately: one of four windows of 64."""
LATE: Final = 0.25
"""A beacon is overdue after this share of its period."""
ANSWER_SLACK_NS: Final = 150_000_000
"""Margin for the delay of two datagrams and of a timer."""


@lru_cache(maxsize=1024)
def overdue_beacons(loss: float, neighbours: int) -> int:
    """Beacons of a neighbour that are missing before it is asked.

    `loss`: of its last beacons, below 1.
    """
    return max(math.ceil(math.log(SUSPICION / neighbours) / math.log(max(loss, LOSS_MIN))), 1)


def silence_ns(beacons: int, period_ns: int) -> int:
    """Time without a beacon after which a neighbour is asked."""
    return round((beacons + LATE) * period_ns)


def asks(loss_in: float, loss_out: float, beacons: int, false_alarm: float) -> int:
    """Requests without an answer that take a link down, after some beacons that are missing.

    All these and an answer to each request are lost with a probability of `false_alarm` at most, where that
    does not need more than ASKS_MAX.
    """
    unanswered = 1.0 - (1.0 - loss_in) * (1.0 - loss_out)
    if unanswered >= 1.0:
        return ASKS_MAX
    needed = (math.log(false_alarm) - beacons * math.log(loss_in)) / math.log(unanswered)
    return min(max(math.ceil(needed), ASKS_MIN), ASKS_MAX)
