"""The routing table: next hop, metric and feasibility distance of each node, loop-free in a moving swarm.

A distance vector with Babel's feasibility condition (RFC 8966, section 3.5.1), adapted to the beacon:
the sequence number of every beacon is the sender's own route sequence number, so each beacon of a node brings
a new route to it, and the same datagrams carry rows about other nodes.
"""

from collections.abc import Iterable
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import (
    HOPS_MAX,
    INFINITY,
    LOST,
    NEVER_NS,
    NeighbourRequest,
    RouteRow,
    SequenceRequest,
)
from swarmd.broker.core.swarm.routes.destination_routes import (
    DestinationRoutes,
    is_much_worse,
    is_urgent,
    newer,
)

HYSTERESIS: Final = 96
"""Required improvement of a new next hop: varying loss must not change routes."""
REFRESH_NS: Final = 330_000_000
"""Refresh period of a row per hop of distance; with 300 ms 50 nodes at 10 m/s send more than 450 B/s."""
REFRESH_MAX_NS: Final = 2_000_000_000
REFRESH_ANYWAY: Final = 1.6
"""Refresh periods after which a row is repeated that has no newer sequence number. Until then it waits for
one: so numbers cross the swarm in waves, with the delay of a beacon on each hop instead of half a period."""
STRETCH_FROM: Final = 80
"""In larger swarms the refresh periods grow with the number of nodes, up to STRETCH_MAX times."""
STRETCH_MAX: Final = 2.0
HOLD_NS: Final = 7_000_000_000
"""A route is lost when its sequence number did not advance for this time, or for three of the longest refresh
periods where these are longer."""
REQUESTED_NS: Final = 2_000_000_000
"""Lifetime of a neighbour's request for a newer row."""
RETRACTIONS: Final = 2
"""Retractions of a lost route: one datagram may be lost."""
SOURCE_GC_NS: Final = 180_000_000_000
"""Lifetime of the feasibility distance of a vanished destination; RFC 8966, appendix B."""
REQUEST_AGAIN_NS: Final = 400_000_000
REQUEST_FOR_NS: Final = 3_000_000_000
FORWARD_AGAIN_NS: Final = 500_000_000
REQUEST_HOPS: Final = HOPS_MAX
REQUESTS_MAX: Final = 32
"""Limit of sequence requests in a beacon, and of those to one neighbour."""
BETTER_RATIO: Final = 0.25
BETTER_BY: Final = 256
"""A route that is not feasible is requested where the present one is worse by this share of it, at least by
one hop without loss (RFC 8966, section 3.8.2.2)."""
SEEK_AGAIN_NS: Final = 1_000_000_000
"""Time within which a destination is not requested of the same neighbour again."""
SEEK_OTHER_NS: Final = 300_000_000
"""Nor of another one within this."""
SEEK_AFTER_NS: Final = 200_000_000
"""Other routes are compared this long after a metric rose: by then those neighbours have advertised the rise
whose routes lead over this node, and they are not asked in vain."""
DESTINATION_LIMIT: Final = 4096
_SWEEP_NS: Final = 1_000_000_000
_FAR_NS: Final = 1 << 62


class RouteChanged(msgspec.Struct, frozen=True, gc=False):
    """The next hop to a node has changed."""

    hw: int
    via: int
    """0: the route is lost."""


class Route(msgspec.Struct, frozen=True, gc=False):
    """The selected route to a node, as listed in reports."""

    hw: int
    via: int
    metric: int
    sequence: int
    changed_ns: int


class RoutingTable:
    """Routing table of one node.

    Loop-free at every instant as long as the caller keeps two rules: rows of a neighbour count
    only while the link is bidirectional, and `drop_link` is called for a restarted neighbour before
    its rows are used (it has lost its feasibility distances).
    """

    def __init__(self, own_hw: int) -> None:
        self.own_hw = own_hw
        self.requested_sequence: int | None = None
        """A higher own sequence number that another node requested or still holds."""
        self._destinations: dict[int, DestinationRoutes] = {}
        self._costs: dict[int, int] = {}
        self._forward: list[SequenceRequest] = []
        self._directed: list[NeighbourRequest] = []
        """Requests to one neighbour each, for the next beacon."""
        self._asking: dict[int, DestinationRoutes] = {}
        self._seeking: dict[int, int] = {}
        """Destinations whose metric rose, and when their other routes are compared."""
        self._sweep_ns = NEVER_NS
        self._hold_ns = HOLD_NS

    # input

    def set_link(self, via: int, cost: int) -> None:
        """Sets the cost of a link that is up."""
        self._costs[via] = cost

    def worsen(self, via: int, now_ns: int) -> list[RouteChanged]:
        """Applies the higher cost of a link to its routes, and selects better ones."""
        changes: list[RouteChanged] = []
        cost = self._costs.get(via)
        if cost is None:
            return changes
        for destination in self._destinations.values():
            if destination.via == via:
                total = destination.advertised[via][1] + cost
                if total > destination.metric:
                    self._set_metric(destination, min(total, INFINITY - 1), now_ns, changes)
        return changes

    def drop_link(self, via: int, now_ns: int) -> list[RouteChanged]:
        """Removes the routes over a lost link or a restarted neighbour."""
        if self._costs.pop(via, None) is None:
            return []
        changes: list[RouteChanged] = []
        for destination in self._destinations.values():
            if destination.advertised.pop(via, None) is not None and destination.via == via:
                self._select(destination, now_ns, changes)
        return changes

    def exclude(self, hw: int, now_ns: int) -> list[RouteChanged]:
        """Takes the routes to a node that is not a member any more; its feasibility distance stays."""
        changes: list[RouteChanged] = []
        destination = self._destinations.get(hw)
        if destination is not None:
            destination.advertised.clear()
            self._select(destination, now_ns, changes)
        return changes

    def on_rows(self, via: int, rows: Iterable[tuple[int, int, int]], now_ns: int) -> list[RouteChanged]:
        """Takes the rows of a neighbour's newest beacon, among them its own row (its sequence, 0)."""
        cost = self._costs.get(via)
        changes: list[RouteChanged] = []
        if cost is None:
            return changes
        destinations = self._destinations
        for hw, sequence, metric in rows:
            destination = destinations.get(hw)
            if destination is None:
                if hw == self.own_hw:
                    # a neighbour that still has a row for this node holds its number; the own number must
                    # pass it
                    if metric != INFINITY:
                        self.requested_sequence = sequence
                    continue
                if metric == INFINITY or not hw or len(destinations) >= DESTINATION_LIMIT:
                    continue  # 0 stands for no node: `via` 0 means that there is no route
                destination = destinations[hw] = DestinationRoutes(hw, now_ns)
            # an infinite metric is a retraction; the neighbour has lost its route
            total = metric + cost
            if total >= INFINITY:
                if destination.advertised.pop(via, None) is not None and destination.via == via:
                    self._select(destination, now_ns, changes)
                continue
            # RFC 8966, section 3.5.1: a row that is not feasible may describe a path over this node
            if not destination.feasible(sequence, metric):
                # kept for the case that a newer number makes it feasible, and asked for one if it is much
                # better
                if via != destination.via:
                    destination.put(via, sequence, metric, now_ns)
                    self._seek(destination, via, total, now_ns)
                elif total > destination.metric:
                    # A longer path. Ours stays loop-free, because our feasibility distance did not change.
                    before = destination.advertised[via]
                    destination.advertised[via] = (before[0], metric, before[2])
                    self._set_metric(destination, total, now_ns, changes)
                continue
            destination.put(via, sequence, metric, now_ns)
            if via == destination.via:
                destination.sequence = sequence
                self._set_metric(destination, total, now_ns, changes)
            # hysteresis; metrics that scatter with the loss must not turn a route back and forth
            elif destination.via == 0 or total + HYSTERESIS < destination.metric:
                self._use(destination, via, sequence, total, now_ns, changes)
        return changes

    def on_requests(self, via: int, requests: Iterable[SequenceRequest], now_ns: int) -> list[RouteChanged]:
        """Takes sequence requests of a neighbour: answers, forwards or records them."""
        changes: list[RouteChanged] = []
        for hw, sequence, hops in requests:
            hops_left = min(hops & ~LOST, REQUEST_HOPS)
            if hw == self.own_hw:
                self.requested_sequence = sequence
                continue
            destination = self._destinations.get(hw)
            if destination is None:
                continue
            if hops & LOST and destination.advertised.pop(via, None) is not None and destination.via == via:
                self._select(destination, now_ns, changes)  # its retractions were lost
            destination.requested_until_ns = now_ns + REQUESTED_NS
            destination.requested_sequence = sequence
            destination.requested = True
            # the own row answers the request if its number is as new; it is in the next beacon
            answered = destination.via != 0 and not newer(sequence, destination.sequence)
            if answered or hops_left <= 1 or now_ns - destination.forwarded_ns < FORWARD_AGAIN_NS:
                continue
            destination.forwarded_ns = now_ns
            if destination.limit_sequence < 0 or newer(sequence, destination.limit_sequence):
                destination.request_due_ns = now_ns + REQUEST_AGAIN_NS  # its answer serves us too
            self._forward.append(SequenceRequest(hw, sequence, hops_left - 1))
        return changes

    def on_neighbour_requests(self, via: int, requests: Iterable[NeighbourRequest], now_ns: int) -> None:
        """Takes the requests of a neighbour to this node: answers, or asks its own next hop.

        They follow routes, which have no loops, and none is repeated within FORWARD_AGAIN_NS.
        """
        for neighbour_hw, hw, sequence, hops in requests:
            if neighbour_hw != self.own_hw:
                continue
            if hw == self.own_hw:
                self.requested_sequence = sequence
                continue
            destination = self._destinations.get(hw)
            if destination is None or destination.via in (0, via):
                continue  # it asks for what it has from us, or before it has our retraction
            destination.requested_until_ns = now_ns + REQUESTED_NS
            destination.requested_sequence = sequence
            destination.requested = True
            if not newer(sequence, destination.sequence) or hops <= 1:
                continue
            if now_ns - destination.forwarded_ns >= FORWARD_AGAIN_NS:
                destination.forwarded_ns = now_ns
                self._request_of(destination.via, hw, sequence, min(hops - 1, REQUEST_HOPS))

    def request_route(self, hw: int, now_ns: int) -> None:
        """Requests a route for traffic that has none."""
        destination = self._destinations.get(hw)
        if destination is not None and destination.via == 0 and now_ns >= destination.request_until_ns:
            self._ask(destination, now_ns)

    def advance(self, now_ns: int) -> list[RouteChanged]:
        """Requests better routes where metrics rose, and removes expired ones; call at each beacon."""
        # a little later than the rise of the metric; first the rows of the other neighbours arrive
        for hw in [hw for hw, due_ns in self._seeking.items() if due_ns <= now_ns]:
            del self._seeking[hw]
            destination = self._destinations[hw]  # forgotten much later than this
            best, total = destination.best_other(self._costs)
            if best:
                self._seek(destination, best, total, now_ns)
        changes: list[RouteChanged] = []
        # a sweep of all rows is too dear for each beacon
        if now_ns < self._sweep_ns:
            return changes
        self._sweep_ns = now_ns + _SWEEP_NS
        forgotten: list[int] = []
        oldest_ns = now_ns - self._hold_ns
        for destination in self._destinations.values():
            advertised = destination.advertised
            for via, row in advertised.items():
                # one stale row is enough to sweep the destination; the row of a direct link ends with its
                # link
                if row[2] < oldest_ns and via != destination.hw:
                    self._expire(destination, oldest_ns, now_ns, changes)
                    break
            # the feasibility distance must outlive all rows that others may still hold (RFC 8966, section
            # 3.7.3)
            if advertised:
                destination.known_ns = now_ns
            elif now_ns - destination.known_ns > SOURCE_GC_NS:
                forgotten.append(destination.hw)
        for hw in forgotten:
            del self._destinations[hw]
            self._forward = [request for request in self._forward if request.hw != hw]
        return changes

    # output

    def rows(self, now_ns: int, room: int, linked: frozenset[int]) -> tuple[RouteRow, ...]:
        """Rows for the next beacon, at most `room`, by urgency.

        `linked`: nodes to which all neighbours have direct links; their rows are not repeated.
        What is advertised here bounds what will be accepted later (RFC 8966, section 3.7.3).
        """
        due: list[DestinationRoutes] = []
        for destination in self._destinations.values():
            # a row that was left out, because all neighbours had direct links, is due once a neighbour has
            # none
            if destination.is_due(now_ns) or (destination.linked and destination.hw not in linked):
                if destination.via or destination.retractions:
                    due.append(destination)
            elif destination.requested and destination.via:
                if now_ns >= destination.requested_until_ns:
                    destination.requested = False
                elif not newer(destination.requested_sequence, destination.sequence):
                    destination.requested = False
                    due.append(destination)
        # retractions go first; routes to a lost node attract frames that are dropped then
        if len(due) > room:
            due.sort(key=_urgency)
            del due[room:]
        # with many destinations the rows are repeated less often, so that beacons keep room for values
        stretch = min(max(1.0, len(self._destinations) / STRETCH_FROM), STRETCH_MAX)
        longest_ns = round(REFRESH_MAX_NS * stretch)
        # a row is held for three of its periods; two beacons in a row may be lost
        self._hold_ns = max(HOLD_NS, 3 * longest_ns)
        rows: list[RouteRow] = []
        for destination in due:
            if not destination.via:
                destination.retractions -= 1
                rows.append(RouteRow(destination.hw, destination.sequence, INFINITY))
                continue
            sequence, metric = destination.advertise(now_ns)
            destination.linked = destination.hw in linked
            if destination.linked:
                destination.due_ns = destination.news_due_ns = _FAR_NS
            else:
                period_ns = min(round(REFRESH_NS * max(1, metric >> 8) * stretch), longest_ns)
                destination.news_due_ns = now_ns + period_ns
                destination.due_ns = now_ns + round(REFRESH_ANYWAY * period_ns)
            rows.append(RouteRow(destination.hw, sequence, metric))
        return tuple(rows)

    def requests(self, now_ns: int) -> tuple[SequenceRequest, ...]:
        """Sequence requests for the next beacon: own and forwarded ones."""
        out: list[SequenceRequest] = []
        for hw, sequence, hops_left in self._forward:
            # set again at each hop; it says whether this node has a route, whatever the first sender had
            lost = LOST if not self._destinations[hw].via else 0
            out.append(SequenceRequest(hw, sequence, hops_left | lost))
        self._forward.clear()
        for destination in list(self._asking.values()):
            if destination.via or now_ns >= destination.request_until_ns:
                del self._asking[destination.hw]
            elif destination.request_due_ns <= now_ns:
                destination.request_due_ns = now_ns + REQUEST_AGAIN_NS
                wanted = (destination.limit_sequence + 1) & 0xFFFF
                out.append(SequenceRequest(destination.hw, wanted, REQUEST_HOPS | LOST))
        return tuple(out)

    def neighbour_requests(self) -> tuple[NeighbourRequest, ...]:
        """Requests to one neighbour each for the next beacon, those to the same one together."""
        out, self._directed = tuple(sorted(self._directed)), []
        return out

    # queries

    def next_hop(self, hw: int) -> int:
        """Next hop to a node, or 0 without a route."""
        destination = self._destinations.get(hw)
        return destination.via if destination is not None else 0

    def routes(self) -> list[Route]:
        """All selected routes, for reports."""
        return [
            Route(d.hw, d.via, d.metric, d.sequence, d.changed_ns)
            for d in self._destinations.values()
            if d.via
        ]

    # route selection

    def _set_metric(
        self, destination: DestinationRoutes, total: int, now_ns: int, changes: list[RouteChanged]
    ) -> None:
        """Sets the metric of the present route; where it rose, others are compared."""
        before, destination.metric = destination.metric, total
        # a small rise is advertised with the next row, and turns no route
        if total <= before + HYSTERESIS:
            return
        self._select(destination, now_ns, changes)
        if is_urgent(destination.metric, destination.advertised_metric) and not destination.linked:
            destination.due_ns = now_ns
        self._seeking.setdefault(destination.hw, now_ns + SEEK_AFTER_NS)

    def _seek(self, destination: DestinationRoutes, via: int, total: int, now_ns: int) -> None:
        """Requests a newer row of a neighbour whose route is much better, but not feasible."""
        # the same neighbour is given time to answer; another one may be asked sooner
        again_ns = SEEK_AGAIN_NS if via == destination.sought_via else SEEK_OTHER_NS
        if (
            destination.via
            and destination.metric > total + max(BETTER_BY, total * BETTER_RATIO)
            and now_ns - destination.sought_ns >= again_ns
        ):
            destination.sought_ns, destination.sought_via = now_ns, via
            self._request_of(via, destination.hw, (destination.limit_sequence + 1) & 0xFFFF, REQUEST_HOPS)

    def _request_of(self, via: int, hw: int, sequence: int, hops_left: int) -> None:
        if len(self._directed) < REQUESTS_MAX:
            self._directed.append(NeighbourRequest(via, hw, sequence, hops_left))

    def _select(self, destination: DestinationRoutes, now_ns: int, changes: list[RouteChanged]) -> None:
        costs = self._costs
        best, best_total, best_sequence = 0, INFINITY, 0
        for via, (sequence, metric, _) in destination.advertised.items():
            total = metric + costs[via]
            # the present route is preferred, as in `on_rows`
            if via == destination.via:
                total = max(total - HYSTERESIS, 1)
            # the present route stays loop-free also where its newest row is not feasible any more
            if total < best_total and (via == destination.via or destination.feasible(sequence, metric)):
                best, best_total, best_sequence = via, total, sequence
        if best == destination.via and best:
            return
        if best:
            total = destination.advertised[best][1] + costs[best]
            self._use(destination, best, best_sequence, total, now_ns, changes)
        elif destination.via:
            # no feasible route; retracted at once and several times, because a loss would leave others with a
            # loop-free but dead route
            destination.via = 0
            destination.metric = destination.advertised_metric = INFINITY
            destination.retractions = RETRACTIONS
            destination.due_ns = destination.changed_ns = now_ns
            changes.append(RouteChanged(destination.hw, 0))
            self._ask(destination, now_ns)

    def _expire(
        self, destination: DestinationRoutes, oldest_ns: int, now_ns: int, changes: list[RouteChanged]
    ) -> None:
        # a direct route expires with its link
        stale = [
            via for via, row in destination.advertised.items() if row[2] < oldest_ns and via != destination.hw
        ]
        for via in stale:
            del destination.advertised[via]
        if destination.via in stale:
            self._select(destination, now_ns, changes)

    def _use(
        self,
        destination: DestinationRoutes,
        via: int,
        sequence: int,
        total: int,
        now_ns: int,
        changes: list[RouteChanged],
    ) -> None:
        destination.via = via
        destination.turned = True  # neighbours need the number to use the new route, too
        destination.sequence = sequence
        destination.metric = total
        destination.changed_ns = now_ns
        destination.retractions = 0
        destination.request_until_ns = NEVER_NS
        before = destination.advertised_metric
        if is_much_worse(total, before) or is_much_worse(before, total):
            destination.due_ns = now_ns  # a little better or worse waits for its next row
        changes.append(RouteChanged(destination.hw, via))

    def _ask(self, destination: DestinationRoutes, now_ns: int) -> None:
        if destination.limit_sequence < 0:
            return  # nothing was advertised: any row is feasible, so none is available
        self._asking[destination.hw] = destination
        destination.request_due_ns = now_ns
        destination.request_until_ns = now_ns + REQUEST_FOR_NS


def _urgency(destination: DestinationRoutes) -> tuple[bool, int]:
    return destination.via != 0, destination.due_ns
