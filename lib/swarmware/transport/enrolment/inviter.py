"""The inviter's decisions: which request is admitted, once per token; what is refused, and why."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

import msgspec

from swarmware.errors import InvalidInput, WireError
from swarmware.transport.enrolment.messages import (
    JoinAnswer,
    JoinRefusal,
    JoinRequest,
    number_of,
    open_receipt,
    open_request,
    refuse,
    seal_answer,
)
from swarmware.transport.enrolment.token import JoinToken, proves

ATTEMPTS: Final = 10
"""Connections of one address in a row; then one a second. A node that joins needs one."""
ATTEMPTS_OF_ALL: Final = 100
"""Connections of all addresses in a row; then ten a second."""
ADDRESSES_MAX: Final = 1024
"""Maximum addresses whose connections are counted; the oldest is forgotten."""
SECOND_NS: Final = 1_000_000_000
RECEIPT_NS: Final = 30 * SECOND_NS
"""Time from an answer in which its receipt, or the same request again, is waited for.

An operator sees at once that `keys join` failed, and repeats its line.
"""


class Invitation(msgspec.Struct, frozen=True):
    """One platform that may join with one token."""

    platform: str
    role: str
    token: JoinToken
    deadline_ns: int
    """End of its validity."""


class Admission(msgspec.Struct, frozen=True):
    """A node proved that it may join: sign a roster with it, then call `Inviter.admitted`."""

    invitation: Invitation
    request: JoinRequest
    repeated: bool
    """True if the node was admitted with this key before, and repeats the request because its answer was
    lost."""


class _Bucket:
    """Connections that are permitted at once, and again as time passes."""

    __slots__ = ("_at_ns", "_level", "_per_second", "_size")

    def __init__(self, size: int, per_second: float, now_ns: int) -> None:
        self._size = self._level = float(size)
        self._per_second = per_second
        self._at_ns = now_ns

    def take(self, now_ns: int) -> bool:
        # computed when asked, so that an idle bucket needs no timer
        gained = (now_ns - self._at_ns) / SECOND_NS * self._per_second
        self._level, self._at_ns = min(self._size, self._level + gained), now_ns
        if self._level < 1:
            return False
        self._level -= 1
        return True


class Inviter:
    """Decides on requests to join; its caller signs the rosters and moves the bytes."""

    def __init__(
        self,
        invitations: Iterable[Invitation],
        former: Mapping[bytes, JoinRefusal],
        nonce: Callable[[], bytes],
        now_ns: int,
    ) -> None:
        """`former`: numbers of earlier tokens, with the reason of their refusal; `nonce`: 12 random bytes."""
        self._open = {one.token.number: one for one in invitations}
        self._former = former
        self._nonce = nonce
        self._keys: dict[bytes, bytes] = {}
        """Public key of the node that joined, by the number of its token."""
        self._unconfirmed: dict[bytes, int] = {}
        """End of the wait for the receipt of a node that joined, by the number of its token."""
        self._expired: set[bytes] = set()
        self._all = _Bucket(ATTEMPTS_OF_ALL, 10.0, now_ns)
        self._sources: dict[str, _Bucket] = {}
        self.garbage = 0
        """Received bytes that are not a request, or that another secret sealed."""
        self.limited = 0
        """Connections beyond the limits."""

    @property
    def pending(self) -> tuple[Invitation, ...]:
        """Invitations that have neither been used nor expired."""
        ended = self._keys.keys() | self._expired
        return tuple(one for number, one in self._open.items() if number not in ended)

    def deadline_ns(self) -> int | None:
        """Instant of the next expiry of an invitation or of the wait for a receipt, or None without
        either."""
        return min((*(one.deadline_ns for one in self.pending), *self._unconfirmed.values()), default=None)

    def expire(self, now_ns: int) -> tuple[Invitation, ...]:
        """The invitations that expire now."""
        over = tuple(one for one in self.pending if one.deadline_ns <= now_ns)
        self._expired.update(one.token.number for one in over)
        return over

    def expire_receipts(self, now_ns: int) -> tuple[Invitation, ...]:
        """The invitations of nodes that joined whose receipt is not waited for any longer."""
        over = [number for number, until_ns in self._unconfirmed.items() if until_ns <= now_ns]
        for number in over:
            del self._unconfirmed[number]
        return tuple(self._open[number] for number in over)

    def on_receipt(self, data: bytes) -> Invitation | None:
        """The invitation of a node that has stored its credentials, or None for bytes without a receipt."""
        for number in self._unconfirmed:
            invitation = self._open[number]
            try:
                open_receipt(invitation.token, data)
            except WireError:
                continue
            del self._unconfirmed[number]
            return invitation
        return None

    def on_connection(self, address: str, now_ns: int) -> bool:
        """Whether a connection of this address may send a request; beyond the limits it is closed."""
        bucket = self._sources.get(address)
        if bucket is None:
            if len(self._sources) >= ADDRESSES_MAX:
                # Addresses can be invented without end: the oldest one goes.
                del self._sources[next(iter(self._sources))]
            bucket = self._sources[address] = _Bucket(ATTEMPTS, 1.0, now_ns)
        # the own bucket first: a flooding address must not empty the bucket of all
        if bucket.take(now_ns) and self._all.take(now_ns):
            return True
        self.limited += 1
        return False

    def on_request(self, data: bytes, utc_ns: int, now_ns: int) -> Admission | bytes | None:
        """Decision on a request: an admission, the bytes of a refusal, or None for garbage."""
        try:
            number = number_of(data)
        except WireError:
            self.garbage += 1
            return None
        found = self._open.get(number)
        if found is None:
            # in clear text: without the token there is no common secret to seal with
            return refuse(self._former.get(number, JoinRefusal.UNKNOWN))
        try:
            # the seal proves the knowledge of the token, the signature below the ownership of the key
            request = open_request(found.token, data)
            genuine = proves(request.sign_public, request.proof, found.token.fingerprint, request.platform)
        except InvalidInput:
            self.garbage += 1
            return None
        refusal, reason = self._judge(found, request, now_ns)
        # last, because the other reasons help an operator more
        if not refusal and not genuine:
            refusal, reason = JoinRefusal.PROOF, "its signature is not of the key that it presented"
        if refusal:
            return self._answer(found, JoinAnswer(utc_ns, refusal, reason))
        return Admission(found, request, repeated=number in self._keys)

    def admitted(
        self,
        admission: Admission,
        root_public: bytes,
        roster: bytes,
        utc_ns: int,
        now_ns: int,
        broker_port: int = 0,
    ) -> bytes:
        """The answer to a node that is on the roster now; its token is used.

        `broker_port`: UDP port of the broker on this computer, a seed of the node, or 0 without one.
        """
        found = admission.invitation
        self._keys[found.token.number] = admission.request.sign_public
        self._unconfirmed[found.token.number] = now_ns + RECEIPT_NS
        return self._answer(
            found, JoinAnswer(utc_ns, root_public=root_public, roster=roster, broker_port=broker_port)
        )

    def failed(self, admission: Admission, reason: str, utc_ns: int) -> bytes:
        """The answer to a node that could not be admitted; its token remains valid."""
        return self._answer(admission.invitation, JoinAnswer(utc_ns, JoinRefusal.FAILED, reason))

    def _judge(self, found: Invitation, request: JoinRequest, now_ns: int) -> tuple[int, str]:
        """The refusal of a request and its reason, or 0 if the node may join."""
        number = found.token.number
        if request.platform != found.platform:
            return JoinRefusal.OTHER_PLATFORM, f"the invitation is for {found.platform}"
        joined = self._keys.get(number)
        if joined == request.sign_public:
            return 0, ""  # its answer was lost: it is a member, also when the token has expired meanwhile
        if joined is not None:
            return JoinRefusal.USED, f"another node has joined as {found.platform} with this token"
        if now_ns >= found.deadline_ns:
            return JoinRefusal.EXPIRED, "its time is over by the inviter's clock"
        return 0, ""

    def _answer(self, invitation: Invitation, answer: JoinAnswer) -> bytes:
        return seal_answer(invitation.token, self._nonce(), answer)
