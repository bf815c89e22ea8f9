"""Conversion functions of all clocks: measured for neighbours, composed for other nodes."""

from typing import Final

import msgspec

from swarmd.timesync.config import Config
from swarmd.timesync.core.peer import ClockEstimator, Exchange, due_together_ns
from swarmware.model.names import Address
from swarmware.runtime.core import AT_ONCE
from swarmware.types.time import FUNCTIONS_LIMIT, HOPS_LIMIT, Conversion, TimeFunctions

MEASURED_NS: Final = 10_000_000_000
"""Age of the newest packet up to which a unit is measured, and not composed. A partner's function may be from
its first seconds, with an inaccurate skew, and is not renewed."""

STATED_NS: Final = 60_000_000_000
"""Lifetime of a partner's functions; they are requested six times in this time while a route needs them."""
LINK_AGE_NS: Final = 30_000_000_000
"""Maximum age of a composed function per link. Each link adds 10 s between two requests and the time between
two estimations; an older function means that a link on the route is silent."""


class Publish(msgspec.Struct, frozen=True):
    """Action: publish the changed functions."""

    functions: TimeFunctions


class ClockStepped(msgspec.Struct, frozen=True):
    """Action: report a clock step; earlier stamps need the old function."""

    platform: str
    unit: str
    conv_epoch: int


class UnitRebooted(msgspec.Struct, frozen=True):
    """Action: report the reboot of a unit, which starts another clock."""

    platform: str
    unit: str


class FunctionsRefused(msgspec.Struct, frozen=True):
    """Action: report implausible functions of a partner, when their number changed."""

    platform: str
    refused: int
    of: int


Action = Publish | ClockStepped | UnitRebooted | FunctionsRefused


class PeerExchange(msgspec.Struct, frozen=True, gc=False):
    """One exchange, with the unit whose clock it measures."""

    platform: str
    unit: str
    hardware: int
    boot_id: int
    exchange: Exchange


class TimeCore:
    """Conversion functions by hardware unit, from exchanges and from the functions of partners."""

    def __init__(
        self,
        platform: str,
        unit: str,
        hardware: int,
        boot_id: int,
        config: Config,
        *,
        first_epoch: int,
    ) -> None:
        self._me = (platform, unit, hardware, boot_id)
        self._config = config
        self._first_epoch = first_epoch
        self._publish_ns = round(config.publish_s * 1e9)
        self._forget_ns = round(config.forget_s * 1e9)
        self._peers: dict[int, ClockEstimator] = {}
        self._partner_functions: dict[int, tuple[TimeFunctions, int]] = {}
        self._suspects: set[int] = set()
        self._refused: dict[str, int] = {}
        """Number of functions refused in the last list of each partner."""
        self._published_ns: int | None = None
        self._expiry_ns: int | None = None
        """Instant at which the next composed function expires."""
        self._changed = False
        self._urgent = False

    def on_exchange(self, sample: PeerExchange, now_ns: int) -> list[Action]:
        """Takes the exchange of one received packet; `on_timer` estimates the functions."""
        actions: list[Action] = []
        peer = self._peers.get(sample.hardware)
        if peer is not None and sample.boot_id != peer.boot_id:
            # a delayed packet from before the reboot
            if sample.boot_id < peer.boot_id:
                return actions
            actions.append(UnitRebooted(sample.platform, sample.unit))
            self._urgent = True
            self._partner_functions.pop(sample.hardware, None)
            peer = None
        if peer is None:
            peer = ClockEstimator(
                sample.platform,
                sample.unit,
                sample.hardware,
                sample.boot_id,
                window_s=self._config.window_s,
                pause_s=self._config.solve_s,
                conv_epoch=self._first_epoch,
            )
            self._peers[sample.hardware] = peer
        if peer.on_exchange(sample.exchange):
            actions.append(self._stepped(peer))
        return actions

    def on_functions(self, received: TimeFunctions, now_ns: int) -> list[Action]:
        """Takes a partner's functions: initial values, plausibility, units out of direct range (S1.70)."""
        peer = next(
            (p for p in self._peers.values() if (p.platform, p.unit) == (received.platform, received.unit)),
            None,
        )
        if peer is None or peer.boot_id != received.boot_id:
            return []
        taken = tuple(one for one in received.functions[:FUNCTIONS_LIMIT] if one.plausible())
        refused = len(received.functions) - len(taken)
        received = msgspec.structs.replace(received, functions=taken)
        self._partner_functions[peer.hardware] = (received, now_ns)
        self._changed = True
        mine = received.of(self._me[0], self._me[1])
        known = peer.conversion
        stated = known is None or not known.samples
        if stated and mine is not None and mine.boot_id == self._me[3] and mine.hops == 1:
            # the partner's measurement of this clock, inverted, serves until this node has measured
            seen = mine.inverse(peer.platform, peer.unit, peer.hardware, peer.boot_id)
            peer.conversion = msgspec.structs.replace(seen, samples=0, rtt_ns=0)
            self._urgent = self._urgent or known is None
        self._suspects = self._find_suspects(now_ns)
        before = self._refused.get(peer.name, 0)
        self._refused[peer.name] = refused
        if refused in {0, before}:
            return []
        return [FunctionsRefused(peer.name, refused, refused + len(taken))]

    def unmeasured(self) -> set[str]:
        """Neighbours without a function, whose measurement of this unit can give an initial one."""
        return {peer.name for peer in self._peers.values() if peer.conversion is None}

    def stated(self) -> set[str]:
        """Neighbours whose function is only an inverted measurement of theirs, and has to be renewed."""
        return {peer.name for peer in self._peers.values() if peer.conversion and not peer.conversion.samples}

    def deadline_ns(self) -> int | None:
        """Instant of the next estimation, expiry or publication, or None if none is due."""
        if self._urgent or (self._changed and self._published_ns is None):
            return AT_ONCE
        dues = [due for peer in self._peers.values() if (due := peer.due_ns()) is not None]
        if self._expiry_ns is not None:
            dues.append(self._expiry_ns)
        if self._changed and self._published_ns is not None:
            dues.append(due_together_ns(self._published_ns, self._publish_ns))
        return min(dues, default=None)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Estimates the functions that are due, and publishes changes."""
        actions: list[Action] = []
        for peer in self._peers.values():
            due_ns = peer.due_ns()
            if due_ns is None or due_ns > now_ns:
                continue
            first = peer.conversion is None
            if peer.solve(now_ns):
                actions.append(self._stepped(peer))
            self._changed |= peer.conversion is not None
            self._urgent |= first and peer.conversion is not None
        if self._expiry_ns is not None and now_ns >= self._expiry_ns:
            self._expiry_ns = None
            self._changed = True
        waited = self._published_ns is None or now_ns - self._published_ns >= self._publish_ns
        if self._urgent or (self._changed and waited):
            self._published_ns = now_ns
            self._changed = self._urgent = False
            actions.append(Publish(self.functions(now_ns)))
        return actions

    def _stepped(self, peer: ClockEstimator) -> ClockStepped:
        self._urgent = True
        self._partner_functions.pop(peer.hardware, None)  # made from the clock before the step
        return ClockStepped(peer.platform, peer.unit, peer.conv_epoch)

    def functions(self, now_ns: int) -> TimeFunctions:
        """All functions, sorted by platform and unit; the limit keeps the functions with the smallest
        bounds."""
        self._forget(now_ns)
        best = {
            peer.hardware: self._marked(peer.conversion)
            for peer in self._peers.values()
            if peer.conversion and peer.conversion.plausible()
        }
        self._expiry_ns = None
        for function, until_ns in self._composed(now_ns):
            known = best.get(function.hardware)
            if known is None or _better(function, known, now_ns):
                best[function.hardware] = function
                self._expiry_ns = until_ns if self._expiry_ns is None else min(self._expiry_ns, until_ns)
        chosen = sorted(best.values(), key=lambda function: function.bound_at_ns(now_ns))[
            : self._config.functions_limit
        ]
        chosen.sort(key=lambda function: (function.platform, function.unit))
        platform, unit, _, boot_id = self._me
        return TimeFunctions(platform, unit, boot_id, now_ns, tuple(chosen))

    def _is_measured(self, hardware: int, now_ns: int) -> bool:
        peer = self._peers.get(hardware)
        if peer is None or peer.conversion is None or not peer.conversion.samples or peer.received_ns is None:
            return False
        return now_ns - peer.received_ns <= MEASURED_NS

    def measured_since(self, since_ns: int) -> set[str]:
        """Names of the nodes that were measured directly since that instant."""
        return {
            peer.name
            for peer in self._peers.values()
            if peer.conversion and peer.received_ns is not None and peer.received_ns >= since_ns
        }

    def _marked(self, function: Conversion) -> Conversion:
        if function.hardware in self._suspects:
            return msgspec.structs.replace(function, suspect=True)
        return function

    def _composed(self, now_ns: int) -> list[tuple[Conversion, int]]:
        """Composed functions of units not measured here, each with the instant at which it expires."""
        out: list[tuple[Conversion, int]] = []
        # own current packets are always better than the function of a partner
        measured = {hardware for hardware in self._peers if self._is_measured(hardware, now_ns)}
        own = str(Address(*self._me[:2]))
        for hardware, (theirs, at_ns) in self._partner_functions.items():
            link = self._peers[hardware].conversion
            if link is None:
                continue
            for further in theirs.functions:
                # a function of this unit, or composed over this unit, would loop
                mine = further.hardware == self._me[2] or further.via == own
                if mine or further.hardware in measured or link.hops + further.hops > HOPS_LIMIT:
                    continue
                composed = link.then(further, str(Address(theirs.platform, theirs.unit)))
                until_ns = min(at_ns + STATED_NS, composed.t0_ns + LINK_AGE_NS * composed.hops)
                if now_ns < until_ns and composed.plausible():
                    out.append((composed, until_ns))
        return out

    def _forget(self, now_ns: int) -> None:
        for hardware, peer in list(self._peers.items()):
            if peer.received_ns is not None and now_ns - peer.received_ns > self._forget_ns:
                del self._peers[hardware]
                self._partner_functions.pop(hardware, None)
        for hardware, (_, at_ns) in list(self._partner_functions.items()):
            if now_ns - at_ns > STATED_NS:
                del self._partner_functions[hardware]

    def _find_suspects(self, now_ns: int) -> set[int]:
        """Units whose function most partners contradict by more than both bounds (triangle closure)."""
        votes: dict[int, int] = {}
        triangles: dict[int, int] = {}
        for hardware, (theirs, _) in self._partner_functions.items():
            link = self._peers[hardware].conversion
            if link is None:
                continue
            for further in theirs.functions:
                peer = self._peers.get(further.hardware)
                measured = further.hops == 1 and peer is not None and further.boot_id == peer.boot_id
                if not measured or peer is None or peer.conversion is None or not peer.conversion.samples:
                    continue
                around = link.then(further, theirs.platform)
                agree = around.agrees(peer.conversion, now_ns)
                # a contradiction does not show which of the two corners errs, so both get the vote
                for corner in (hardware, further.hardware):
                    triangles[corner] = triangles.get(corner, 0) + 1
                    votes[corner] = votes.get(corner, 0) + (not agree)
        return {corner for corner, count in votes.items() if count * 2 > triangles[corner]}


def _better(one: Conversion, other: Conversion, now_ns: int) -> bool:
    """True if `one` has the later boot, is newer where both contradict, or else has the smaller bound."""
    if one.boot_id != other.boot_id:
        return one.boot_id > other.boot_id
    if not one.agrees(other, now_ns):  # one of the clocks on the route has stepped
        return one.t0_ns > other.t0_ns
    return one.bound_at_ns(now_ns) < other.bound_at_ns(now_ns)
