"""Sources of beacons: a member can seal a beacon in the name of another one, but not sign it.

Every node signs one beacon in five seconds, so most beacons are taken unsigned, on trust in the last
signature. As soon as something shows that another member seals beacons in the name of a node, only signed
ones of that node are taken, and it is asked to sign all. Where the roster says that members sign all, no
unsigned one is taken at any time.
"""

from collections.abc import Callable
from typing import Final

import msgspec

from swarmd.broker.core.admission.signing_keys import SigningKeys
from swarmd.broker.core.beacon.beacon import NEVER_NS, Beacon, Header
from swarmd.broker.core.beacon.beacon_history import BeaconHistory
from swarmd.broker.core.beacon.beacon_signature import BeaconSignature, signed_content
from swarmd.broker.core.beacon.session_checks import CheckKind
from swarmd.broker.core.beacon.value_proof import ValueProof, body_hash, prove, value_hash
from swarmware.model.names import Address, hardware_id
from swarmware.transport.sodium import verify

RENEWAL_NS: Final = 11_000_000_000
"""Age of the last signature after which the node is asked for one: the last two periodic ones were lost."""
TRUST_NS: Final = 14_000_000_000
"""Age of the last signature after which no unsigned beacon is taken; three times the declared period where
that is longer."""
TRUST_PERIODS: Final = 3
GUARD_NS: Final = 60_000_000_000
"""Time without unsigned beacons after the last evidence."""
ASK_AGAIN_NS: Final = 300_000_000
"""Minimum period of questions for signatures to one node."""
EXTEND_NS: Final = 20_000_000_000
"""Last part of the time in which a node signs all: when unsigned beacons arrive then, it is asked to
continue."""
JUMP: Final = 64
"""Numbers that a sequence may be ahead of the last signed one, beside those that its rate explains."""
RATE_HZ: Final = 60.0
"""Highest rate of beacons: `tick_hz` is at most 50, and some are triggered."""
BURST: Final = 8
"""Unsigned beacons that may arrive at once, after a delay on the way."""
HOSTS_MAX: Final = 4
"""Source addresses of unsigned beacons that are remembered."""
ENFORCED_NS: Final = 5_000_000_000
"""Time from a roster that says so until unsigned beacons are refused: until then all neighbours have it."""
REMIND_NS: Final = 2_000_000_000
"""Age of the last signature after which a node that must sign all is asked: it does not know the roster."""
OVERTAKEN: Final = 4
"""Beacons that a signed one may be overtaken by."""


class SealedDatagram(msgspec.Struct, frozen=True, gc=False):
    """A datagram whose seal is valid: a member made it."""

    clear: bytes
    """Its clear header."""
    body: bytes
    digest: int
    """See `datagram_digest`."""
    host: str
    """Source address, which its sender can falsify."""
    is_new: bool
    """The replay window has taken its number; otherwise it was not opened for that."""
    medium: int = 0
    """Number of the medium that it came over: each has a delay of its own."""


class Verdict(msgspec.Struct, frozen=True, gc=False):
    """What follows from a beacon of an accepted session."""

    is_taken: bool
    refusal: str = ""
    """The counter of `Refused` of one that is not taken."""
    is_evidence: bool = False
    """It proves that a member seals beacons in the name of its sender."""
    forgets: bool = False
    """Beacons may have been accepted that its sender did not send: forget their values."""
    ask: CheckKind | None = None
    """What to ask its sender."""
    suspects: tuple[str, ...] = ()
    """Addresses that the false beacons can have come from."""
    continues_at: int | None = None
    """Number with which the replay window begins again."""


TAKEN: Final = Verdict(is_taken=True)
"""The common case: no further consequence."""


class _Source:
    """What is known of the beacons of one session of a node."""

    __slots__ = (
        "asked_ns",
        "burst",
        "drained_ns",
        "former_hosts",
        "guarded_until_ns",
        "history",
        "hosts",
        "period_ns",
        "session",
        "signed_host",
        "signed_ns",
        "signed_sequence",
        "signs_until_ns",
        "tops",
    )

    def __init__(self, session: int) -> None:
        self.session = session
        self.signed_sequence = -1
        self.signed_ns = NEVER_NS
        self.signed_host = ""
        self.hosts: set[str] = set()
        """Source addresses of the unsigned beacons since the last signed one."""
        self.former_hosts: set[str] = set()
        """Those of the time between the two last signed ones."""
        self.history = BeaconHistory()
        self.guarded_until_ns = NEVER_NS
        """Until when no unsigned beacon is taken."""
        self.signs_until_ns = NEVER_NS
        """Until when the node signs every beacon, as it states."""
        self.tops: dict[int, int] = {}
        """Highest number that was taken, by medium."""
        self.period_ns = 0
        """Declared in a signed beacon."""
        self.asked_ns = NEVER_NS
        self.burst = 0.0
        self.drained_ns = NEVER_NS

    def ask(self, kind: CheckKind, now_ns: int) -> CheckKind | None:
        """The question, unless it was asked just now."""
        if now_ns - self.asked_ns < ASK_AGAIN_NS:
            return None
        self.asked_ns = now_ns
        return kind

    def record(self, sequence: int, datagram: SealedDatagram) -> None:
        """Remembers a beacon that is taken."""
        self.history.record(sequence, datagram.digest)
        self.tops[datagram.medium] = max(self.tops.get(datagram.medium, -1), sequence)

    def suspects(self, host: str) -> tuple[str, ...]:
        """Addresses that false beacons can have come from, when one arrives from this address."""
        all_hosts = self.hosts | self.former_hosts | {host}
        return tuple(sorted(all_hosts - {self.signed_host} or all_hosts))

    def is_too_fast(self, now_ns: int) -> bool:
        """Whether more unsigned beacons arrive than a node sends."""
        drained = self.burst - (now_ns - self.drained_ns) / 1e9 * RATE_HZ
        self.burst, self.drained_ns = max(0.0, drained), now_ns
        if self.burst > BURST - 1:
            return True
        self.burst += 1
        return False


class Sources:
    """Judges the beacons of nodes in range by their signatures."""

    def __init__(self, keys: SigningKeys, platform_of: Callable[[int], str]) -> None:
        self._keys = keys
        self._platform_of = platform_of
        self._all: dict[int, _Source] = {}
        self._proven: tuple[SealedDatagram, ValueProof] | None = None
        """The last datagram with a proof: it is needed twice."""
        self._signed_from_ns: int | None = None
        """From when on no unsigned beacon is taken; None: some are."""

    def require(self, signs: bool, from_ns: int) -> None:
        """Takes what the roster says: whether members sign every beacon, so that none without a signature is
        taken from an instant on."""
        if not signs or self._signed_from_ns is None:
            self._signed_from_ns = from_ns if signs else None

    def forget(self, hw: int) -> None:
        """Removes a node that is not a member any more."""
        self._all.pop(hw, None)

    def is_ahead(self, header: Header, now_ns: int) -> bool:
        """Whether a number is so far ahead that only a signature can explain it: the replay window must not
        take it before."""
        source = self._all.get(header.sender_hw)
        if source is None or header.session not in (None, source.session):
            return False
        limit = JUMP + (now_ns - source.signed_ns) / 1e9 * RATE_HZ
        return header.sequence - source.signed_sequence > limit

    def is_other(self, header: Header, digest: int) -> bool:
        """Whether a datagram that the replay window refuses may be a true one, the number of which a false
        one has used."""
        source = self._all.get(header.sender_hw)
        if source is None or header.session not in (None, source.session):
            return False
        if header.sequence <= source.signed_sequence:
            return False
        return source.history.digest(header.sequence) != digest

    def is_signed(self, header: Header, beacon: Beacon, datagram: SealedDatagram) -> bool | None:
        """Whether the sender itself signed a beacon; None: there is no signature, or no name that says whose
        key it is."""
        found = beacon.signature
        if found is None or header.session is None:
            return None
        platform = self._platform_of(header.sender_hw)
        if beacon.hello is not None and hardware_id(beacon.hello.name) == header.sender_hw:
            platform = Address.parse(beacon.hello.name).platform
        public = self._keys.sign_public_of(platform)
        if public is None:
            return None
        proof = self.proof(header, beacon, datagram)
        if proof is not None:
            return verify(public, found.value, proof.signed_content(header.sender_hw))
        signed = datagram.body[: found.signed_bytes]
        content = signed_content(header.sender_hw, header.session, datagram.clear, signed)
        return verify(public, found.value, content)

    def proof(self, header: Header, beacon: Beacon, datagram: SealedDatagram) -> ValueProof | None:
        """What proves the values of a beacon to others, if its signature is valid; None: it proves none."""
        found = beacon.signature
        if found is None or found.clock_high is None or header.session is None:
            return None
        if self._proven is not None and self._proven[0] is datagram:
            return self._proven[1]
        clock_us = found.clock_high << 32 | header.tx_us
        leaves = [
            value_hash(value.data_id, clock_us - value.age_us, value.packed, value.payload)
            for value in beacon.values
        ]
        hashed = body_hash(datagram.clear, datagram.body[: found.signed_bytes])
        proof = prove(header.session, hashed, leaves, found.value)
        self._proven = datagram, proof
        return proof

    def judge(
        self,
        header: Header,
        beacon: Beacon,
        datagram: SealedDatagram,
        is_signed: bool | None,
        now_ns: int,
    ) -> Verdict:
        """Decides about a beacon of the accepted session of its sender; `is_signed`: as the method returns
        it."""
        hw, session = header.sender_hw, header.session or 0
        source = self._all.get(hw)
        if source is None or source.session != session:
            source = self._all[hw] = _Source(session)
        if is_signed and beacon.signature is not None:
            return self._on_signed(source, header.sequence, beacon, beacon.signature, datagram, now_ns)
        if self._signed_from_ns is not None and now_ns >= self._signed_from_ns:
            return self._on_unsigned_of_all(source, header.sequence, datagram, is_signed, now_ns)
        if is_signed is False:
            return self._on_evidence(source, datagram.host, now_ns)
        return self._on_unsigned(source, header.sequence, datagram, now_ns)

    def _on_signed(
        self,
        source: _Source,
        sequence: int,
        beacon: Beacon,
        signature: BeaconSignature,
        datagram: SealedDatagram,
        now_ns: int,
    ) -> Verdict:
        history = source.history
        if sequence <= source.signed_sequence:
            source.record(sequence, datagram)
            return TAKEN if datagram.is_new else Verdict(is_taken=False, refusal="replayed")
        before = history.digest(sequence)
        is_evidence = (
            source.tops.get(datagram.medium, -1) - sequence > OVERTAKEN
            or (before is not None and before != datagram.digest)
            or history.contradicts(signature.salt, sequence, signature.groups)
        )
        if is_evidence:
            source.history, source.tops = BeaconHistory(), {}
            source.guarded_until_ns = now_ns + GUARD_NS
        source.record(sequence, datagram)
        source.signed_host = datagram.host
        suspects = source.suspects(datagram.host) if is_evidence else ()
        source.former_hosts, source.hosts = source.hosts, set()
        source.signed_sequence, source.signed_ns, source.burst = sequence, now_ns, 0.0
        if beacon.hello is not None:
            source.period_ns = beacon.hello.period_ms * 1_000_000
        source.signs_until_ns = now_ns + signature.signs_all_s * 1_000_000_000
        if signature.signs_all_s:
            source.guarded_until_ns = max(source.guarded_until_ns, source.signs_until_ns)
        ask = source.ask(CheckKind.SIGN, now_ns) if is_evidence and not signature.signs_all_s else None
        continues_at = sequence if is_evidence or not datagram.is_new else None
        return Verdict(
            is_taken=True,
            is_evidence=is_evidence,
            forgets=is_evidence,
            ask=ask,
            suspects=suspects,
            continues_at=continues_at,
        )

    def _on_unsigned_of_all(
        self,
        source: _Source,
        sequence: int,
        datagram: SealedDatagram,
        is_signed: bool | None,
        now_ns: int,
    ) -> Verdict:
        """The verdict where every beacon must have a signature, about one without a valid one."""
        is_later = sequence > source.signed_sequence  # its sender signs all now, as it stated
        is_evidence = is_signed is False or (is_later and now_ns < source.signs_until_ns)
        is_reminder = now_ns - source.signed_ns >= REMIND_NS
        return Verdict(
            is_taken=False,
            refusal="unsigned",
            is_evidence=is_evidence,
            ask=source.ask(CheckKind.SIGN, now_ns) if is_reminder else None,
            suspects=(datagram.host,) if is_evidence else (),
        )

    def _on_unsigned(self, source: _Source, sequence: int, datagram: SealedDatagram, now_ns: int) -> Verdict:
        if now_ns < source.guarded_until_ns:
            is_ending = source.signs_until_ns - now_ns < EXTEND_NS
            ask = source.ask(CheckKind.SIGN, now_ns) if is_ending else None
            return Verdict(is_taken=False, refusal="unsigned", ask=ask)
        if source.history.digest(sequence) not in (None, datagram.digest):
            return self._on_evidence(source, datagram.host, now_ns)
        age_ns = now_ns - source.signed_ns
        question = CheckKind.QUESTION
        if not datagram.is_new or age_ns > max(TRUST_NS, TRUST_PERIODS * source.period_ns):
            return Verdict(is_taken=False, refusal="unproven", ask=source.ask(question, now_ns))
        if source.is_too_fast(now_ns):
            return Verdict(is_taken=False, refusal="unproven", ask=source.ask(question, now_ns))
        source.record(sequence, datagram)
        if len(source.hosts) < HOSTS_MAX:
            source.hosts.add(datagram.host)
        if age_ns > max(RENEWAL_NS, (TRUST_PERIODS - 1) * source.period_ns):
            return Verdict(is_taken=True, ask=source.ask(question, now_ns))
        return TAKEN

    def _on_evidence(self, source: _Source, host: str, now_ns: int) -> Verdict:
        source.guarded_until_ns = now_ns + GUARD_NS
        source.asked_ns = now_ns
        return Verdict(
            is_taken=False,
            refusal="unsigned",
            is_evidence=True,
            forgets=True,
            ask=CheckKind.SIGN,
            suspects=source.suspects(host),
        )
