"""Routes to one destination: rows of the neighbours, feasibility distance, and the last advertisement."""

from typing import Final

from swarmd.broker.core.beacon.beacon import INFINITY, NEVER_NS

WORSE_RATIO: Final = 2
WORSE_BY: Final = 256
"""A metric above the ratio of another and this, one hop without loss, is much worse than it: smaller changes
wait for their next row. With a ratio of 1.5, and turned routes advertised at once, 100 nodes at 10 m/s sent a
seventh to two fifths more (tests/simulation/directory/table.py)."""
URGENT_RATIO: Final = 1.5
"""A metric that rose above this ratio of the advertised one, and one hop, is advertised at once. With 2, a
rise behind a dozen hops waited for the next row, for up to 6 s, while the link that caused it ended."""
HELD_NS: Final = 5_000_000_000
"""Time for which a route that became much worse is advertised with its former sequence number."""


def newer(one: int, other: int) -> bool:
    """Whether sequence number `one` comes after `other`, modulo 2¹⁶."""
    return 0 < (one - other) & 0xFFFF < 0x8000


def is_much_worse(metric: int, than: int) -> bool:
    """Whether other nodes should turn to another next hop."""
    return metric >= than * WORSE_RATIO + WORSE_BY


def is_urgent(metric: int, advertised_metric: int) -> bool:
    """Whether other nodes should know at once that a metric rose."""
    return metric >= advertised_metric * URGENT_RATIO + WORSE_BY


class DestinationRoutes:
    """Routes of a node to one destination."""

    __slots__ = (
        "advertised",
        "advertised_metric",
        "advertised_sequence",
        "changed_ns",
        "due_ns",
        "forwarded_ns",
        "held_until_ns",
        "hw",
        "known_ns",
        "limit_metric",
        "limit_sequence",
        "linked",
        "metric",
        "news_due_ns",
        "request_due_ns",
        "request_until_ns",
        "requested",
        "requested_sequence",
        "requested_until_ns",
        "retractions",
        "sequence",
        "sought_ns",
        "sought_via",
        "turned",
        "usual_metric",
        "via",
    )

    def __init__(self, hw: int, now_ns: int) -> None:
        self.hw = hw
        self.advertised: dict[int, tuple[int, int, int]] = {}
        """By neighbour: sequence number and metric of its last row, feasible or not, and when the number last
        rose."""
        self.via = 0
        self.metric = INFINITY
        self.sequence = 0
        self.limit_sequence = -1
        """Feasibility distance, with `limit_metric`, or -1 before the first advertisement."""
        self.limit_metric = INFINITY
        self.known_ns = now_ns
        self.changed_ns = now_ns
        self.due_ns = now_ns
        """When its row is due, whether or not it has changed."""
        self.news_due_ns = now_ns
        """When its row is due with a newer sequence number than the last one."""
        self.linked = False
        """All neighbours had direct links to it when its row was sent last."""
        self.advertised_metric = INFINITY
        self.advertised_sequence = -1
        self.held_until_ns = NEVER_NS
        """Until when the sequence number of its rows does not rise, or NEVER_NS if it is not held."""
        self.usual_metric = INFINITY
        """Last advertised metric before the route became much worse."""
        self.turned = False
        """The next hop has changed since the last row."""
        self.retractions = 0
        self.requested_until_ns = NEVER_NS
        self.requested_sequence = 0
        self.requested = False
        """A neighbour waits for a row with `requested_sequence`."""
        self.forwarded_ns = NEVER_NS
        self.request_until_ns = NEVER_NS
        self.request_due_ns = NEVER_NS
        self.sought_ns = NEVER_NS
        """When one neighbour was asked last for a newer row of a better route."""
        self.sought_via = 0
        """Neighbour that was asked last."""

    def feasible(self, sequence: int, metric: int) -> bool:
        """Whether a route of a neighbour with this row cannot lead back (RFC 8966, section 3.5.1)."""
        if self.limit_sequence < 0:
            return True
        if sequence == self.limit_sequence:
            return metric < self.limit_metric
        return newer(sequence, self.limit_sequence)

    def put(self, via: int, sequence: int, metric: int, now_ns: int) -> None:
        """Stores the row of a neighbour."""
        before = self.advertised.get(via)
        # a row that repeats its number says only that the neighbour lives, not that the destination does
        fresh_ns = now_ns if before is None or before[0] != sequence else before[2]
        self.advertised[via] = (sequence, metric, fresh_ns)

    def best_other(self, costs: dict[int, int]) -> tuple[int, int]:
        """Neighbour with the best row beside the next hop, feasible or not, and the metric over it."""
        best, best_total = 0, INFINITY
        for via, (_, metric, _) in self.advertised.items():
            if via != self.via and metric + costs[via] < best_total:
                best, best_total = via, metric + costs[via]
        return best, best_total

    def is_due(self, now_ns: int) -> bool:
        """Whether its row belongs into the next beacon."""
        if self.due_ns <= now_ns:
            return True
        return self.news_due_ns <= now_ns and self.sequence != self.advertised_sequence

    def advertise(self, now_ns: int) -> tuple[int, int]:
        """Sequence number and metric of the next row; they bound what is feasible later.

        Where the route became much worse, the number rises only with a new next hop for a while: an older one
        is always loop-free, and routes over other nodes, whose numbers rise, become feasible before this one
        ends.
        """
        sequence, metric = self.sequence, self.metric
        much_worse = is_much_worse(metric, self.usual_metric)
        if much_worse and self.held_until_ns == NEVER_NS:
            self.held_until_ns = now_ns + HELD_NS
        if not much_worse or now_ns >= self.held_until_ns:
            self.usual_metric, self.held_until_ns = metric, NEVER_NS
        elif not self.turned and self.limit_sequence >= 0 and newer(sequence, self.limit_sequence):
            sequence = self.limit_sequence
        self.turned = False
        # the distance only falls, unless the number rises: RFC 8966, section 3.7.3
        if self.feasible(sequence, metric):
            self.limit_sequence, self.limit_metric = sequence, metric
        self.advertised_sequence, self.advertised_metric = self.sequence, metric
        return sequence, metric
