"""Forwarding decision of a frame: deliver, send to a next hop, or refuse with a reason."""

from enum import IntEnum
from typing import Final

import msgspec

from swarmd.broker.core.swarm.routes.routing_table import RoutingTable
from swarmware.model.frame import HOPS, Frame

SEEN_MAX: Final = 4096
LOOP_NS: Final = 90_000_000
"""A frame received again within this time is in a loop; later it is a retransmission over another route:
senders wait 100 ms at least."""


class ForwardStep(IntEnum):
    """Outcome of a forwarding decision."""

    DELIVER = 1
    SEND = 2
    NO_ROUTE = 3
    HOP_LIMIT = 4
    LOOPED = 5
    """Received again with fewer hops left."""
    SPOOFED = 6
    """Another member than its sender sent it with all its hops left."""


class ForwardDecision(msgspec.Struct, frozen=True, gc=False):
    """Forwarding decision of one frame."""

    step: ForwardStep
    via: int = 0
    """Hardware id of the next hop."""
    first: bool = True
    """The frame is not a retransmission of a forwarded frame."""


_DELIVER: Final = ForwardDecision(ForwardStep.DELIVER)
_REPEATED: Final = ForwardDecision(ForwardStep.DELIVER, first=False)
_HOP_LIMIT: Final = ForwardDecision(ForwardStep.HOP_LIMIT)
_LOOPED: Final = ForwardDecision(ForwardStep.LOOPED)
_SPOOFED: Final = ForwardDecision(ForwardStep.SPOOFED)

_Identity = tuple[int, int, int, int, int]


class FrameForwarder:
    """Forwards frames along the routing table and stops loops.

    A retransmission by the sender (its acknowledgement was lost) is forwarded again. A frame that returns
    within milliseconds with fewer hops left is in a loop and is dropped.
    """

    def __init__(self, own_hw: int, routing: RoutingTable) -> None:
        self._own_hw = own_hw
        self._routing = routing
        self._seen: dict[_Identity, tuple[int, int]] = {}

    def from_here(self, frame: Frame, now_ns: int) -> ForwardDecision:
        """Decides about a frame of a local application; it starts with all its hops.

        A refusal in the name of an unreachable receiver starts with one hop less.
        """
        frame.hops_left = HOPS if frame.sender_hw == self._own_hw else HOPS - 1
        return self._onward(frame, self._first(frame, now_ns), now_ns)

    def has_route(self, hw: int) -> bool:
        """Whether a node can be reached now."""
        return bool(self._routing.next_hop(hw))

    def reroute(self, frame: Frame, now_ns: int) -> ForwardDecision:
        """Decides again about a frame queued for a lost neighbour."""
        return self._onward(frame, False, now_ns)

    def from_neighbour(self, frame: Frame, neighbour_hw: int | None, now_ns: int) -> ForwardDecision:
        """Decides about a frame from a link; `neighbour_hw`: the member at its other end, None without
        authentication."""
        # only the sender itself sends a frame with all its hops
        if frame.hops_left >= HOPS and neighbour_hw is not None and frame.sender_hw != neighbour_hw:
            return _SPOOFED
        if frame.sender_hw == self._own_hw:
            return _LOOPED
        if frame.receiver_hw == self._own_hw:
            return _DELIVER if self._first(frame, now_ns) else _REPEATED
        # fewer hops than a moment ago; it has passed here before; a retransmission has as many
        before = self._seen.get(_identity(frame))
        if before is not None and frame.hops_left < before[0] and now_ns - before[1] < LOOP_NS:
            return _LOOPED
        if frame.hops_left <= 1:
            return _HOP_LIMIT
        first = self._first(frame, now_ns)
        frame.hops_left -= 1
        return self._onward(frame, first, now_ns)

    def _onward(self, frame: Frame, first: bool, now_ns: int) -> ForwardDecision:
        via = self._routing.next_hop(frame.receiver_hw)
        if not via:
            # a route may exist that is not feasible: RFC 8966, section 3.8.2.1, asks for a newer number
            self._routing.request_route(frame.receiver_hw, now_ns)
            return ForwardDecision(ForwardStep.NO_ROUTE, first=first)
        return ForwardDecision(ForwardStep.SEND, via, first)

    def _first(self, frame: Frame, now_ns: int) -> bool:
        seen, identity = self._seen, _identity(frame)
        # removed and inserted again, so that the oldest entry is the first of the dictionary
        first = seen.pop(identity, None) is None
        if len(seen) >= SEEN_MAX:
            del seen[next(iter(seen))]
        seen[identity] = (frame.hops_left, now_ns)
        return first


def _identity(frame: Frame) -> _Identity:
    return frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence, frame.kind
