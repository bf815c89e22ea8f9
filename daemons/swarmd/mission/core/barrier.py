"""Barriers of an ensemble: members publish their arrival, and all leave at one common time (S4.10, S4.23).

The first participant opens a barrier: it publishes the common time on its own clock; the others convert it.
A time-out, or a member that is lost or has ended, breaks a barrier for all members that wait (S4.17).
A ground station is an exception: a flying swarm waits for a present station, but continues without a station
that is lost, has ended or timed out, unless the barrier names its role.
"""

from collections import OrderedDict
from collections.abc import Callable, Collection
from typing import Final

import msgspec

from swarmd.mission.core.run import MAKING_WAY
from swarmware.mission.outcome import BARRIER_BROKEN, SUCCESS, TIMED_OUT, BlockOutcome
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import INACTIVE, Arrival, BarrierResult, Member, MissionPhase, MissionState
from swarmware.types.net import Neighbours, Routes

OVER: Final = INACTIVE | {MissionPhase.ENDING, MissionPhase.RECOVERING}
"""States of a member that will not arrive at any further barrier."""
ORDERED: Final = frozenset({MissionPhase.ABORTED})
"""States that a ground station enters only on an instruction: then it counts like any other member."""
PATIENCE: Final = 3
"""Factor on the time-out of a member whose computer still sends while its mission state is missing."""
MEMORY: Final = 16
"""Number of barrier results that a member stores."""
ANNOUNCED: Final = 3
"""Number of the newest results that a member keeps publishing, for members that arrive late."""

LATE_NS: Final = 500_000_000
"""Maximum lateness of a barrier result; for a waiting member that receives it later the barrier is broken."""

Key = tuple[str, int]


class BarrierSpec(msgspec.Struct, frozen=True):
    """A barrier as defined in the mission of one member."""

    barrier: str
    visit: int
    quorum: int | None = None
    """Number of arrivals that open the barrier, or None if all participants must arrive."""
    roles: tuple[str, ...] = ()
    """Roles that participate, or () for all roles."""
    timeout_s: float | None = None


class Passed(msgspec.Struct, frozen=True):
    """The end of a wait at a barrier."""

    token: int
    result: BlockOutcome
    text: str = ""


class _OtherMember(msgspec.Struct):
    """State of another member as received here."""

    state: MissionState | None = None
    """Newest state of the member in this run, or None before the first one."""
    received_ns: int = 0
    alive_ns: int = 0
    """Instant of the last datagram from the member's computer, whatever its content."""
    left: bool = False
    """True if the member took part, and now plays another mission or was restarted."""
    suspended_ns: int | None = None
    """Instant since which the member has suspended this run for another one, or None if it has not."""


class _Waiting(msgspec.Struct):
    spec: BarrierSpec
    since_ns: int
    deadline_ns: int | None
    patience_ns: int
    """Length of the time-out of the barrier, by which the common start extends its deadline."""


class _Known(msgspec.Struct):
    """The result of a barrier as known here."""

    leave_ns: int | None
    """Common time on the own clock, or None if the barrier is broken."""
    by: int
    """Index of the member that decided the result."""
    relayed: bool
    """True if a member sent the result that did not decide it: its time was converted more than once."""
    since_ns: int
    """When this member received it."""
    passed: bool = False
    """True if this member has passed the barrier, which makes the result final."""


class Barriers:
    """One member's view of all barriers of one run."""

    def __init__(
        self,
        me: str,
        members: tuple[Member, ...],
        epoch: int,
        lost_after_ns: int,
        lead: Callable[[int], int],
        strict: frozenset[str] = frozenset(),
        tolerance_ns: int = 0,
    ) -> None:
        """`lead`: returns the nanoseconds from the opening of a barrier, now, to the common time.

        `tolerance_ns`: time after which a suspended member is lost for a barrier.
        """
        self._me = me
        self._members = members
        self._stations = frozenset(member.platform for member in members if member.kind == PlatformKind.GCS)
        self._strict = strict
        """Barriers that a ground station breaks like any other member."""
        self._epoch = epoch
        self._lost_after_ns = lost_after_ns
        self._tolerance_ns = tolerance_ns
        self._lead = lead if len(members) > 1 else lambda _now_ns: 0
        self._rank = {member.platform: rank for rank, member in enumerate(members)}
        self._peers = {member.platform: _OtherMember() for member in members if member.platform != me}
        self._waiting: dict[int, _Waiting] = {}
        self._known: OrderedDict[Key, _Known] = OrderedDict()
        self._expected = False
        self._judged_ns = -(1 << 63)

    @property
    def arrivals(self) -> tuple[Arrival, ...]:
        """Barriers at which this member waits, for its board."""
        return tuple(Arrival(w.spec.barrier, w.spec.visit) for w in self._waiting.values())

    @property
    def results(self) -> tuple[BarrierResult, ...]:
        """The newest results, on this member's clock, for its board."""
        newest = list(self._known.items())[-ANNOUNCED:]
        return tuple(BarrierResult(*key, known.leave_ns, known.by) for key, known in newest)

    def has_result(self, barrier: str) -> bool:
        """Whether the first visit of a barrier was decided, as far as this member knows."""
        return (barrier, 1) in self._known

    def expect_all(self, now_ns: int) -> None:
        """Begins to count silent members as lost."""
        self._expected = True
        for peer in self._peers.values():
            peer.received_ns = peer.alive_ns = now_ns

    def on_loop_delay(self, late_ns: int) -> None:
        """Extends the time-outs of the others by the time for which this node did not listen."""
        for peer in self._peers.values():
            peer.received_ns += late_ns
            peer.alive_ns += late_ns

    def on_alive(self, platform: str, now_ns: int) -> None:
        """Records that datagrams of a member arrive, even if its mission state was lost."""
        peer = self._peers.get(platform)
        if peer is not None:
            peer.alive_ns = max(peer.alive_ns, now_ns)

    def on_state(
        self, platform: str, state: MissionState, results: tuple[BarrierResult, ...], now_ns: int
    ) -> None:
        """Takes in another member's state; `results` are its barrier results on the clock of this member."""
        peer = self._peers.get(platform)
        if peer is None:
            return
        takes_part = state.epoch == self._epoch
        if self._epoch in state.kept or (takes_part and state.state in MAKING_WAY):
            self._on_suspended(peer, now_ns)
        elif takes_part:
            peer.suspended_ns = None
        else:
            peer.left = peer.left or peer.state is not None or peer.suspended_ns is not None
        if not takes_part:
            return  # its results belong to another run, in which a barrier may have the same id
        peer.state, peer.received_ns, peer.left = state, now_ns, False
        for result in results:
            if result.leave_ns is None and self._is_from_dispensable(result):
                continue  # a station that lost its link must not stop vehicles that still see each other
            relayed = result.by != self._rank[platform]
            self._learn((result.barrier, result.visit), result.leave_ns, result.by, relayed, now_ns)

    def _on_suspended(self, peer: _OtherMember, now_ns: int) -> None:
        """Records that a member plays another run first, and has suspended this one or not begun it."""
        if peer.suspended_ns is None:  # the tolerance counts from the first report
            peer.suspended_ns = now_ns
        peer.received_ns, peer.left = now_ns, False
        if not self._expected:
            # the common start waits for a member whose turn has not come
            for waiting in self._waiting.values():
                if waiting.deadline_ns is not None:
                    waiting.deadline_ns = max(waiting.deadline_ns, now_ns + waiting.patience_ns)

    def arrive(self, token: int, spec: BarrierSpec, now_ns: int) -> None:
        """Begins the wait of this member at a barrier."""
        patience_ns = round((spec.timeout_s or 0) * 1e9)
        deadline_ns = None if spec.timeout_s is None else now_ns + patience_ns
        self._waiting[token] = _Waiting(spec, now_ns, deadline_ns, patience_ns)

    def withdraw(self, token: int) -> None:
        """Ends the wait of this member at a barrier."""
        self._waiting.pop(token, None)

    def advance(self, now_ns: int) -> list[Passed]:
        """Returns the waits that have ended; call it after every event and at the deadline."""
        passed: list[Passed] = []
        self._judged_ns = now_ns  # `deadline_ns` then omits losses that this call has seen
        for token, waiting in list(self._waiting.items()):
            result = self._result(waiting, now_ns)
            if result is not None:
                del self._waiting[token]
                passed.append(Passed(token, *result))
        return passed

    def deadline_ns(self) -> int | None:
        """When `advance` must be called."""
        instants: list[int] = []
        for waiting in self._waiting.values():
            known = self._known.get((waiting.spec.barrier, waiting.spec.visit))
            if known is not None:
                # a wait at a broken barrier ends at the next call
                instants.append(-(1 << 63) if known.leave_ns is None else known.leave_ns)
                continue
            if waiting.deadline_ns is not None:
                instants.append(waiting.deadline_ns)
            if self._expected:
                # a loss that was evaluated and did not break the barrier needs no further call
                instants += [
                    lost_ns + 1
                    for name in self._participants(waiting.spec)
                    if name != self._me
                    and not self._peers[name].left
                    and (lost_ns := self._lost_ns(self._peers[name])) >= self._judged_ns
                ]
        return min(instants, default=None)

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Members for whom this one waits."""
        return tuple(
            name
            for waiting in self._waiting.values()
            for name in self._needed(waiting.spec, now_ns)
            if not self._is_there(name, waiting.spec, now_ns)
        )

    def _result(self, waiting: _Waiting, now_ns: int) -> tuple[BlockOutcome, str] | None:
        spec = waiting.spec
        key = (spec.barrier, spec.visit)
        if key not in self._known:
            self._judge(waiting, now_ns)
        known = self._known.get(key)
        if known is None:
            return None
        if known.leave_ns is None:
            if waiting.deadline_ns is not None and waiting.deadline_ns <= now_ns:
                return TIMED_OUT, self._why(spec, now_ns)
            return BARRIER_BROKEN, self._why(spec, now_ns)
        if known.leave_ns > now_ns:
            return None
        known.passed = True
        # A member that arrives after a quorum has left may pass. A member that waited for all others and
        # learns late that they have left must not follow alone.
        late = known.since_ns - known.leave_ns > LATE_NS
        if late and spec.quorum is None and waiting.since_ns <= known.leave_ns:
            return BARRIER_BROKEN, f"the others left {(now_ns - known.leave_ns) / 1e9:.1f} s ago"
        return SUCCESS, ""

    def _judge(self, waiting: _Waiting, now_ns: int) -> None:
        """Opens or breaks the barrier if this member has to decide it now."""
        spec = waiting.spec
        participants = self._needed(spec, now_ns)
        there = [name for name in participants if self._is_there(name, spec, now_ns)]
        gone = sum(1 for name in participants if name not in there and self._is_gone(name, now_ns))
        needed = len(participants) if spec.quorum is None else min(spec.quorum, len(participants))
        key = (spec.barrier, spec.visit)
        if len(there) >= needed:
            # only the first participant decides: two members would choose two common times
            if there[0] == self._me:
                leave_ns = now_ns + self._lead(now_ns)
                self._learn(key, leave_ns, self._rank[self._me], relayed=False, now_ns=now_ns)
            elif waiting.deadline_ns is not None and waiting.deadline_ns <= now_ns:
                # the first participant has not decided in time: its result may never arrive
                self._learn(key, None, self._rank[self._me], relayed=False, now_ns=now_ns)
        elif (
            len(participants) - gone < needed
            or (waiting.deadline_ns is not None and waiting.deadline_ns <= now_ns)
            or self._is_history(spec)
        ):
            self._learn(key, None, self._rank[self._me], relayed=False, now_ns=now_ns)

    def _is_history(self, spec: BarrierSpec) -> bool:
        """Whether a member is at a later visit of this barrier: results of earlier ones are not stored any
        more."""
        here = Arrival(spec.barrier, spec.visit)
        return any(barrier == spec.barrier and visit > spec.visit for barrier, visit in self._known) or any(
            arrival.barrier == spec.barrier and arrival.visit > spec.visit
            for peer in self._peers.values()
            if peer.state is not None and here not in peer.state.arrivals
            for arrival in peer.state.arrivals
        )

    def _learn(self, key: Key, leave_ns: int | None, by: int, relayed: bool, now_ns: int) -> None:
        """Stores a result; of two results, a broken barrier precedes, then the result of the first member.

        All members apply this order, so that all decide alike."""
        known = self._known.get(key)
        if known is None:
            self._known[key] = _Known(leave_ns, by, relayed, now_ns)
            while len(self._known) > MEMORY:
                self._known.popitem(last=False)
        elif known.passed or known.leave_ns is None:
            return
        elif leave_ns is None or (by, relayed) < (known.by, known.relayed):
            known.leave_ns, known.by, known.relayed = leave_ns, by, relayed

    def _participants(self, spec: BarrierSpec) -> list[str]:
        return [m.platform for m in self._members if not spec.roles or m.role in spec.roles]

    def _needed(self, spec: BarrierSpec, now_ns: int) -> list[str]:
        """Participants, except lost or ended ground stations that the barrier does not need."""
        return [
            name
            for name in self._participants(spec)
            if not (self._dispensable(name, spec.barrier) and self._is_gone(name, now_ns))
        ]

    def _dispensable(self, name: str, barrier: str) -> bool:
        """Whether the other members may continue without this member."""
        if name not in self._stations or name == self._me or barrier in self._strict:
            return False
        state = self._peers[name].state
        return state is None or state.state not in ORDERED

    def _is_from_dispensable(self, result: BarrierResult) -> bool:
        """Whether a ground station reports a broken barrier: it lost the others, or its wait timed out."""
        if not 0 <= result.by < len(self._members):
            return False
        return self._dispensable(self._members[result.by].platform, result.barrier)

    def _is_there(self, name: str, spec: BarrierSpec, now_ns: int) -> bool:
        if name == self._me:
            return True
        state = self._peers[name].state
        if state is None or self._peers[name].suspended_ns is not None or self._is_gone(name, now_ns):
            return False
        return Arrival(spec.barrier, spec.visit) in state.arrivals

    def _is_gone(self, name: str, now_ns: int) -> bool:
        peer = self._peers.get(name)
        if peer is None:
            return False
        if peer.left or (peer.suspended_ns is None and peer.state is not None and peer.state.state in OVER):
            return True
        return self._expected and now_ns > self._lost_ns(peer)

    def _lost_ns(self, peer: _OtherMember) -> int:
        """Instant at which a member counts as lost, unless a datagram of it arrives before."""
        received_ns = peer.received_ns
        if peer.suspended_ns is not None:
            # its silence counts late, since nothing waits for it yet, and its absence after the tolerance
            return min(received_ns + PATIENCE * self._lost_after_ns, peer.suspended_ns + self._tolerance_ns)
        # other datagrams extend the time-out, but not for ever: the mission daemon alone may have stopped
        last_ns = min(max(received_ns, peer.alive_ns), received_ns + (PATIENCE - 1) * self._lost_after_ns)
        return last_ns + self._lost_after_ns

    def _why(self, spec: BarrierSpec, now_ns: int) -> str:
        names = [n for n in self._needed(spec, now_ns) if not self._is_there(n, spec, now_ns)]
        return f"without {', '.join(names)}" if names else ""


LEAD_BEACONS: Final = 2.5
"""Beacon periods per hop for a barrier result: the next beacon carries it, or the following beacon
after a loss."""
LEAD_MAX_NS: Final = 5_000_000_000


def lead_ns(min_ns: int, beacon_hz: float, hops: int) -> int:
    """The lead for members at a maximum hop count, at the lowest beacon rate on the route."""
    if beacon_hz <= 0:
        return min_ns
    return max(min_ns, min(round(LEAD_BEACONS * max(hops, 1) * 1e9 / beacon_hz), LEAD_MAX_NS))


def lead_to_ns(
    platforms: Collection[str],
    *,
    min_ns: int,
    own_hz: float,
    routes: Routes | None,
    neighbours: Neighbours | None,
) -> int:
    """The lead for these members, with the present routes and beacon rates.

    `own_hz`: beacon rate of this node, or 0 if unknown. Rates of nodes that relay to a member are included.
    """
    ways = [route for route in routes.routes if route.platform in platforms] if routes else []
    relays = {route.via for route in ways if route.hops > 1}
    known = neighbours.neighbours if neighbours else ()
    rates_hz = [own_hz, *(each.tick_hz for each in known if each.name in relays)]
    slowest_hz = min((hz for hz in rates_hz if hz > 0), default=0.0)
    return lead_ns(min_ns, slowest_hz, max((route.hops for route in ways), default=1))
