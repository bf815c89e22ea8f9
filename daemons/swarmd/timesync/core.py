"""All clocks of the swarm as seen from here: measured where heard, composed where not."""

from typing import Final

import msgspec

from swarmd.timesync.config import Config
from swarmd.timesync.peer import Exchange, Peer
from swarmware.runtime.core import AT_ONCE
from swarmware.types.time import FUNCTIONS_LIMIT, HOPS_LIMIT, Conversion, TimeFunctions

MEASURED_NS: Final = 10_000_000_000
"""A unit whose packets came within this time is measured here, whatever a partner states of it: a partner's
function of its first seconds has a rate that is hardly known, and is not renewed."""

STATED_NS: Final = 60_000_000_000
"""What a partner stated is used for so long: while there is a way over it, it is asked six times in that."""
LINK_AGE_NS: Final = 30_000_000_000
"""A composed function is at most so old for each of its links: each adds the time between two questions,
10 s, and that between two solutions. An older one means that a link on the way is silent."""


class Publish(msgspec.Struct, frozen=True):
    """The functions have changed: put them on the board."""

    functions: TimeFunctions


class Stepped(msgspec.Struct, frozen=True):
    """A clock has stepped; stamps from before need the old function."""

    platform: str
    unit: str
    conv_epoch: int


class Rebooted(msgspec.Struct, frozen=True):
    """A unit started anew: another clock altogether."""

    platform: str
    unit: str


class Refused(msgspec.Struct, frozen=True):
    """A partner states functions that no two real clocks can have, in another number than before."""

    platform: str
    refused: int
    of: int


Action = Publish | Stepped | Rebooted | Refused


class Heard(msgspec.Struct, frozen=True, gc=False):
    """One exchange and whose it is."""

    platform: str
    unit: str
    hardware: int
    boot_id: int
    exchange: Exchange


class TimeCore:
    """Conversion functions by hardware unit, from exchanges and from what partners tell."""

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
        self._peers: dict[int, Peer] = {}
        self._told: dict[int, tuple[TimeFunctions, int]] = {}
        self._suspects: set[int] = set()
        self._refused: dict[str, int] = {}
        """Functions refused in the last list of each partner."""
        self._published_ns: int | None = None
        self._expiry_ns: int | None = None
        """When the next composed function of the list ends."""
        self._changed = False
        self._urgent = False

    def on_exchange(self, heard: Heard, now_ns: int) -> list[Action]:
        """One received packet of a neighbour; `on_timer` makes functions of what has come."""
        actions: list[Action] = []
        peer = self._peers.get(heard.hardware)
        if peer is not None and heard.boot_id != peer.boot_id:
            if heard.boot_id < peer.boot_id:
                return actions
            actions.append(Rebooted(heard.platform, heard.unit))
            self._urgent = True
            self._told.pop(heard.hardware, None)
            peer = None
        if peer is None:
            peer = Peer(
                heard.platform,
                heard.unit,
                heard.hardware,
                heard.boot_id,
                window_s=self._config.window_s,
                pause_s=self._config.solve_s,
                conv_epoch=self._first_epoch,
            )
            self._peers[heard.hardware] = peer
        if peer.on_exchange(heard.exchange):
            actions.append(self._stepped(peer))
        return actions

    def on_functions(self, told: TimeFunctions, now_ns: int) -> list[Action]:
        """A partner's functions: first values, plausibility, and the way to units not heard here (S1.70)."""
        peer = next(
            (p for p in self._peers.values() if (p.platform, p.unit) == (told.platform, told.unit)), None
        )
        if peer is None or peer.boot_id != told.boot_id:
            return []
        taken = tuple(one for one in told.functions[:FUNCTIONS_LIMIT] if one.plausible())
        refused = len(told.functions) - len(taken)
        told = msgspec.structs.replace(told, functions=taken)
        self._told[peer.hardware] = (told, now_ns)
        self._changed = True
        mine = told.of(self._me[0], self._me[1])
        known = peer.conversion
        stated = known is None or not known.samples
        if stated and mine is not None and mine.boot_id == self._me[3] and mine.hops == 1:
            seen = mine.inverse(peer.platform, peer.unit, peer.hardware, peer.boot_id)
            peer.conversion = msgspec.structs.replace(seen, samples=0, rtt_ns=0)
            self._urgent = self._urgent or known is None
        self._suspects = self._find_suspects(now_ns)
        before = self._refused.get(peer.platform, 0)
        self._refused[peer.platform] = refused
        if refused in {0, before}:
            return []
        return [Refused(peer.platform, refused, refused + len(taken))]

    def unmeasured(self) -> set[str]:
        """Platforms that are heard and have no function yet: their own of us is a first value."""
        return {peer.platform for peer in self._peers.values() if peer.conversion is None}

    def stated(self) -> set[str]:
        """Platforms that are heard, of which only what they state is known: it has to be renewed."""
        return {
            peer.platform for peer in self._peers.values() if peer.conversion and not peer.conversion.samples
        }

    def deadline_ns(self) -> int | None:
        """When `on_timer` has something to do."""
        if self._urgent or (self._changed and self._published_ns is None):
            return AT_ONCE
        dues = [due for peer in self._peers.values() if (due := peer.due_ns()) is not None]
        if self._expiry_ns is not None:
            dues.append(self._expiry_ns)
        if self._changed and self._published_ns is not None:
            dues.append(self._published_ns + self._publish_ns)
        return min(dues, default=None)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Solves what is due, publishes when there is news."""
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

    def _stepped(self, peer: Peer) -> Stepped:
        self._urgent = True
        self._told.pop(peer.hardware, None)  # they speak of the clock before the step
        return Stepped(peer.platform, peer.unit, peer.conv_epoch)

    def functions(self, now_ns: int) -> TimeFunctions:
        """All functions, best known first where the list is full, then sorted by platform and unit."""
        self._forget(now_ns)
        best = {
            peer.hardware: self._marked(peer.conversion)
            for peer in self._peers.values()
            if peer.conversion and peer.conversion.plausible()
        }
        self._expiry_ns = None
        for function, until_ns in self._composed(now_ns):
            known = best.get(function.hardware)
            # what a partner stated once is never as good as packets that still come
            if self._is_measured(function.hardware, now_ns):
                continue
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
        if peer is None or peer.conversion is None or not peer.conversion.samples or peer.heard_ns is None:
            return False
        return now_ns - peer.heard_ns <= MEASURED_NS

    def heard_since(self, since_ns: int) -> set[str]:
        """Platforms measured directly, the last time not before that."""
        return {
            peer.platform
            for peer in self._peers.values()
            if peer.conversion and peer.heard_ns is not None and peer.heard_ns >= since_ns
        }

    def _marked(self, function: Conversion) -> Conversion:
        if function.hardware in self._suspects:
            return msgspec.structs.replace(function, suspect=True)
        return function

    def _composed(self, now_ns: int) -> list[tuple[Conversion, int]]:
        """Functions over partners, each with the instant at which it ends unless it is renewed."""
        out: list[tuple[Conversion, int]] = []
        for hardware, (told, at_ns) in self._told.items():
            link = self._peers[hardware].conversion
            if link is None:
                continue
            for further in told.functions:
                # What a partner knows through us, or about us, is not news.
                mine = further.hardware == self._me[2] or further.via == self._me[0]
                if mine or link.hops + further.hops > HOPS_LIMIT:
                    continue
                composed = link.then(further, told.platform)
                until_ns = min(at_ns + STATED_NS, composed.t0_ns + LINK_AGE_NS * composed.hops)
                if now_ns < until_ns and composed.plausible():
                    out.append((composed, until_ns))
        return out

    def _forget(self, now_ns: int) -> None:
        for hardware, peer in list(self._peers.items()):
            if peer.heard_ns is not None and now_ns - peer.heard_ns > self._forget_ns:
                del self._peers[hardware]
                self._told.pop(hardware, None)
        for hardware, (_, at_ns) in list(self._told.items()):
            if now_ns - at_ns > STATED_NS:
                del self._told[hardware]

    def _find_suspects(self, now_ns: int) -> set[int]:
        """Units whose function most partners contradict beyond both bounds: triangles that do not close."""
        votes: dict[int, int] = {}
        triangles: dict[int, int] = {}
        for hardware, (told, _) in self._told.items():
            link = self._peers[hardware].conversion
            if link is None:
                continue
            for further in told.functions:
                peer = self._peers.get(further.hardware)
                measured = further.hops == 1 and peer is not None and further.boot_id == peer.boot_id
                if not measured or peer is None or peer.conversion is None or not peer.conversion.samples:
                    continue
                around = link.then(further, told.platform)
                agree = around.agrees(peer.conversion, now_ns)
                for corner in (hardware, further.hardware):
                    triangles[corner] = triangles.get(corner, 0) + 1
                    votes[corner] = votes.get(corner, 0) + (not agree)
        return {corner for corner, count in votes.items() if count * 2 > triangles[corner]}


def _better(one: Conversion, other: Conversion, now_ns: int) -> bool:
    """Of a later start of that unit; the newer when both cannot be true; the one with the smaller bound."""
    if one.boot_id != other.boot_id:
        return one.boot_id > other.boot_id
    if not one.agrees(other, now_ns):  # that clock has stepped, or one on the way to it
        return one.t0_ns > other.t0_ns
    return one.bound_at_ns(now_ns) < other.bound_at_ns(now_ns)
