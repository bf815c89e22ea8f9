"""Acceptance of sessions: a session of a node is accepted after it has answered a challenge.

A seal proves that a member made a datagram, not when: it may be a replay. So every new session is challenged:
it must name our present session, which no recorded datagram can do. A session that follows an accepted
one is proven over a connection that only the key of the platform opens; until then the former one stays
accepted.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core.beacon.beacon import NEVER_NS
from swarmd.broker.core.beacon.parts.session_checks import CheckKind, SessionCheck
from swarmd.broker.core.membership.roster.roster_exchange import RosterExchange
from swarmd.broker.core.membership.signatures.own_signatures import SigningKeys
from swarmware.footprint.blake2b import blake2b

ALIVE_NS: Final = 1_500_000_000
"""A session without a datagram for this time has ended: two beacons a second are sent, one may be lost."""
ENDED_NS: Final = 700_000_000
"""Silence after which a session has ended if no datagram of it came since the other session began."""
AGAIN_NS: Final = 90_000_000
"""Minimum period of the same question."""
PROVE_NS: Final = 300_000_000
FORGET_NS: Final = 10_000_000_000
"""Lifetime of a session that does not answer."""
CHECKS_MAX: Final = 16
"""Limit of checks in a beacon; the rest follow in the next one."""
CLAIMS_MAX: Final = 256
PRESENT_MAX: Final = 4096
PROMPT_QUESTIONS: Final = 3
"""Questions per session that trigger a beacon."""


class SwarmMembership(NamedTuple):
    """How a node with keys takes part in its swarm; without keys all fields have their defaults."""

    exchange: RosterExchange | None = None
    """Exchange of the roster with neighbours."""
    signing: SigningKeys | None = None
    """Keys that sign own beacons and check received beacons."""
    connections: bool = False
    """Whether sessions can be proven over connections."""
    curve_of: Callable[[str], bytes | None] | None = None
    """CURVE key of a platform on the roster."""


class AdoptSession(msgspec.Struct, frozen=True):
    """Action: accept the sequence numbers of a session from now on."""

    hw: int
    session: int


class ProveSession(msgspec.Struct, frozen=True):
    """Action: send a neighbour the own session over a connection that only the own key opens."""

    hw: int
    session: int


class ReportImpersonation(msgspec.Struct, frozen=True):
    """Action: report a beacon that a member has sealed in the name of another one."""

    hw: int
    """Hardware id of the node whose name was used."""
    host: str
    """Source address of the beacon."""
    is_other_key: bool = False
    """The beacon is signed, of a session that is not accepted: the node may sign with another key than the
    roster has."""


class ReportDuplicate(msgspec.Struct, frozen=True):
    """Action: report that two computers use one platform name."""

    platform: str
    own: bool
    """The platform name is the own one."""
    first: bool
    """The duplicate was not reported before."""


class ReportDuplicateGone(msgspec.Struct, frozen=True):
    """Action: report that each platform name is used by one computer again."""


class SessionOutcome(msgspec.Struct, frozen=True, gc=False):
    """Consequences of one datagram."""

    accepted: bool
    """The datagram belongs to the accepted session of its sender."""
    adopted: bool = False
    """True if this datagram made the session the accepted one."""
    soon: bool = False
    """A question or an answer is due: trigger a beacon."""
    prove: bool = False
    """Prove our session to the sender over a connection."""
    duplicate: bool = False
    """Two computers use the name of this sender at the same time."""


ACCEPTED: Final = SessionOutcome(accepted=True)
"""The common case: no further consequence."""


class _PendingSession:
    __slots__ = (
        "answered",
        "asked_ns",
        "by_network",
        "count",
        "first_ns",
        "proven",
        "received_ns",
        "session",
    )

    def __init__(self, session: int, now_ns: int) -> None:
        self.session = session
        self.first_ns = now_ns
        self.received_ns = now_ns
        self.asked_ns = NEVER_NS
        self.count = 0
        self.answered = False
        self.proven = False
        self.by_network = False
        """A medium with connections brought a beacon of it, so it can prove itself."""


class _CurrentSession:
    __slots__ = ("proved_ns", "proven", "received_ns", "session")

    def __init__(self, session: int, proven: bool, now_ns: int) -> None:
        self.session = session
        self.proven = proven
        """Proven over a connection; any member could send an answer."""
        self.received_ns = now_ns
        self.proved_ns = NEVER_NS
        """When the own session was proven to it last."""

    def may_prove(self, now_ns: int) -> bool:
        """Whether the own session is proven to it now: its questions cannot cause a flood of proofs."""
        if now_ns - self.proved_ns < PROVE_NS:
            return False
        self.proved_ns = now_ns
        return True


class Sessions:
    """Accepted and pending sessions of all nodes in range.

    They are apart from the records of neighbours: a replay can claim a session, which must not take the place
    of a neighbour, and an accepted session counts until another one is proven, also after minutes of silence.
    """

    def __init__(self, own_hw: int, own_session: int, *, connections: bool) -> None:
        """`connections`: whether sessions can be proven over connections; not without keys."""
        self._own_hw = own_hw
        self._digest = digest(own_session)
        self._connections = connections
        self._present: dict[int, _CurrentSession] = {}
        self._claims: dict[tuple[int, int], _PendingSession] = {}
        self._answers: dict[int, int] = {}
        self._questions: dict[int, SessionCheck] = {}
        self.meets = False
        """Whether the next beacon answers the question of a session that was not accepted when it came."""

    def present(self, hw: int) -> int | None:
        """The accepted session of a node."""
        present = self._present.get(hw)
        return None if present is None else present.session

    def on_datagram(
        self,
        hw: int,
        session: int,
        checks: tuple[SessionCheck, ...],
        now_ns: int,
        *,
        is_proven: bool = True,
        by_network: bool = True,
    ) -> SessionOutcome:
        """Takes a datagram with a valid seal, perhaps of another computer with the own name.

        `is_proven`: its sender made it; any other member could have made an unproven one, whose questions
        count, but not its answers, and which does not keep its session alive. `by_network`: its sender can
        prove itself over a connection.
        """
        present = self._present.get(hw)
        is_present = present is not None and present.session == session
        if present is not None and is_present and is_proven:
            present.received_ns = now_ns
        # nearly every datagram ends here
        if is_present and not checks:
            return ACCEPTED
        answered = prove = soon = False
        for check in checks:
            # checks for other nodes, or for a former session of this node, which a replay would name
            if check.hw != self._own_hw or check.digest != self._digest:
                continue
            if check.kind == CheckKind.ANSWER:
                answered = is_proven
            elif check.kind in (CheckKind.QUESTION, CheckKind.PROVE):
                self._answer(hw, session)
                soon = True
                self.meets = self.meets or not is_present
                prove = prove or check.kind == CheckKind.PROVE
        if hw == self._own_hw:
            # another computer with our name; a replay of our former session cannot answer
            self._answer(hw, session)
            return SessionOutcome(False, soon=True, duplicate=answered)
        if present is not None and is_present:
            return SessionOutcome(True, soon=soon, prove=prove and present.may_prove(now_ns))
        # another session than the accepted one; a restart, a second computer, or a replay
        claim = self._claim(hw, session, now_ns)
        claim.received_ns = now_ns
        claim.by_network = claim.by_network or by_network
        claim.answered = claim.answered or answered
        # as long as it is only a claim, the accepted session stays as it is
        if self._may_follow(present, claim, now_ns):
            adopted = self._adopt(hw, claim, now_ns, has_hello=answered)
            return SessionOutcome(True, adopted=True, soon=True, prove=prove and adopted.may_prove(now_ns))
        duplicate = self._is_duplicate(present, claim)
        asked = self._ask(hw, claim, present is not None, now_ns)
        return SessionOutcome(False, soon=soon or asked, duplicate=duplicate)

    def on_proof(self, hw: int, session: int, now_ns: int) -> None:
        """Takes the proof of a session, over a connection that only the key of the node opens."""
        present = self._present.get(hw)
        if present is not None and present.session == session:
            present.proven = True
            return
        claim = self._claims.get((hw, session))
        if claim is not None:
            claim.proven = claim.answered = True

    def forget(self, hw: int) -> None:
        """Removes the sessions of a node whose key is not on the roster any more."""
        self._present.pop(hw, None)
        self._questions.pop(hw, None)
        self._answers.pop(hw, None)
        for key in [key for key in self._claims if key[0] == hw]:
            del self._claims[key]

    def due(self, now_ns: int) -> tuple[SessionCheck, ...]:
        """Removes and returns the checks for the next beacon."""
        out = [SessionCheck(CheckKind.ANSWER, hw, value) for hw, value in self._answers.items()][:CHECKS_MAX]
        for check in out:
            del self._answers[check.hw]
        # answers go first, because the other side repeats its question only after a pause
        questions = list(self._questions.values())[: CHECKS_MAX - len(out)]
        for check in questions:
            del self._questions[check.hw]
        self._forget(now_ns)
        self.meets = False
        return (*out, *questions)

    @property
    def waiting(self) -> int:
        """Number of checks for the next beacon."""
        return min(len(self._answers) + len(self._questions), CHECKS_MAX)

    # internal

    def _answer(self, hw: int, session: int) -> None:
        if len(self._answers) < CLAIMS_MAX:
            self._answers[hw] = digest(session)

    def _claim(self, hw: int, session: int, now_ns: int) -> _PendingSession:
        claim = self._claims.get((hw, session))
        if claim is None:
            # replays of many former sessions must not take memory; the claim that is silent longest goes
            if len(self._claims) >= CLAIMS_MAX:
                del self._claims[min(self._claims, key=lambda key: self._claims[key].received_ns)]
            claim = self._claims[hw, session] = _PendingSession(session, now_ns)
        return claim

    def _may_follow(self, present: _CurrentSession | None, claim: _PendingSession, now_ns: int) -> bool:
        if not claim.answered:
            return False
        if present is None:
            return True
        if self._connections and claim.by_network:
            if not claim.proven:
                return False
            if not present.proven:
                return True  # the other one gave only an answer
        elif self._connections and claim.session <= present.session:
            return False  # without a proof only a number that rises: a replay has a former one
        # both proven: the former one must have ended, or there are two computers
        followed = present.received_ns <= claim.first_ns
        return now_ns - present.received_ns >= (ENDED_NS if followed else ALIVE_NS)

    def _is_duplicate(self, present: _CurrentSession | None, claim: _PendingSession) -> bool:
        if present is None or present.received_ns <= claim.first_ns:
            return False
        return claim.proven if self._connections else claim.answered

    def _adopt(self, hw: int, claim: _PendingSession, now_ns: int, *, has_hello: bool) -> _CurrentSession:
        if len(self._present) >= PRESENT_MAX:
            longest = min(self._present, key=lambda key: self._present[key].received_ns)
            del self._present[longest]
        adopted = self._present[hw] = _CurrentSession(claim.session, claim.proven, now_ns)
        for key in [key for key in self._claims if key[0] == hw]:
            del self._claims[key]
        self._questions.pop(hw, None)
        # without a hello the name and clock of the new session are unknown; one more question brings it
        if not has_hello:  # an answer comes with one
            self._questions[hw] = SessionCheck(CheckKind.QUESTION, hw, digest(claim.session))
        return adopted

    def _ask(self, hw: int, claim: _PendingSession, prove: bool, now_ns: int) -> bool:
        """Asks about a session; returns True if that triggers a beacon."""
        if now_ns - claim.asked_ns < AGAIN_NS:
            return False
        claim.asked_ns = now_ns
        claim.count += 1
        # a node that follows another session proves itself by its key; the first one only has to answer
        by_connection = prove and self._connections and claim.by_network
        kind = CheckKind.PROVE if by_connection else CheckKind.QUESTION
        self._questions[hw] = SessionCheck(kind, hw, digest(claim.session))
        if claim.count == 1:
            # it will ask the same; an answer at once saves its question
            self._answer(hw, claim.session)
            self.meets = True
        return claim.count <= PROMPT_QUESTIONS

    def _forget(self, now_ns: int) -> None:
        old = [key for key, claim in self._claims.items() if now_ns - claim.received_ns > FORGET_NS]
        for key in old:
            del self._claims[key]


def digest(session: int) -> int:
    """Digest of a session in questions and answers."""
    return int.from_bytes(blake2b(session.to_bytes(8, "little"), digest_size=4).digest(), "little")
