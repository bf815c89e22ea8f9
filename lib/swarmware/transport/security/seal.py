"""Encryption (sealing) of datagrams with the group key, with a derived key per sender and session."""

import struct
from enum import IntEnum
from typing import Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.footprint.blake2b import blake2b
from swarmware.transport.retransmission.received_numbers import ReceivedNumbers
from swarmware.transport.sodium import KEY_BYTES, SealKey

REPLAY_WINDOW: Final = 64
"""Maximum reordering of datagrams; an older one is refused."""
SESSIONS_MAX: Final = 4
"""Maximum sessions of one sender in an opener: the present one and claimed successors."""
SENDER_LIMIT: Final = 4096
"""Maximum senders in an opener; only those with a valid seal are added."""
SESSION_MARK: Final = 0xFFFF
"""Bits of a session that distinguish the swarms on one network: the first two bytes of the fingerprint of the
root, or 0 without keys. The others rise with each start."""
EPOCHS: Final = 16
"""Key epochs that a datagram distinguishes: four bits."""

_SESSION = struct.Struct("<IQ")
_NONCE = struct.Struct("<II4x")
_TAGGED: Final = b"swarmware tick 1"


class GroupKey(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The secret of all members, with its number."""

    epoch: int
    """Rises with each rotation."""
    key: bytes

    @property
    def mark(self) -> int:
        """The epoch as datagrams carry it: the low four bits."""
        return self.epoch % EPOCHS


class Refusal(IntEnum):
    """Why a datagram was not opened."""

    EPOCH = 1
    """Sealed with a group key of another number."""
    UNKNOWN = 2
    """The session of the sender is not known yet."""
    FORGED = 3
    """The seal is not of this group, or the bytes were changed."""
    REPLAYED = 4
    """A duplicate, or too old to detect one."""


class Opened(msgspec.Struct, frozen=True, gc=False):
    """The content of a datagram that a member sealed."""

    body: bytes
    session: int
    """Session of the sender, which identifies its start."""


class Sealer:
    """Seals the datagrams of one sender's session; a sequence number may be used once."""

    def __init__(self, group: GroupKey, sender_hw: int, session: int) -> None:
        self._seal = _session_key(group.key, sender_hw, session).seal
        self._sender_hw = sender_hw
        self._last = -1

    def seal(self, sequence: int, clear: bytes, body: bytes) -> bytes:
        """The body encrypted, with a tag over it and the clear header.

        Raises: InvalidInput when the sequence number does not rise: a repeated nonce reveals the key stream.
        """
        if sequence <= self._last:
            raise InvalidInput(f"sequence {sequence}: expected more than {self._last}")
        self._last = sequence
        return self._seal(_NONCE.pack(self._sender_hw, sequence), body, clear)


class ReceivedSession:
    """Opens the datagrams of one session of a sender, and refuses those whose numbers were taken."""

    __slots__ = ("_open", "_taken", "number")

    def __init__(self, number: int, key: SealKey, window: int = REPLAY_WINDOW) -> None:
        self.number = number
        self._open = key.open
        self._taken = ReceivedNumbers(span=window)

    def open(self, sender_hw: int, sequence: int, clear: bytes, box: bytes) -> Opened | Refusal:
        """The body, or why it is refused: forged or replayed. Its number stays unused until `take`."""
        # Before the decryption, which costs far more than the check of the window.
        if sequence in self._taken:
            return Refusal.REPLAYED
        body = self._open(_NONCE.pack(sender_hw, sequence), box, clear)
        return Refusal.FORGED if body is None else Opened(body, self.number)

    def take(self, sequence: int) -> None:
        """Refuses this number from now on: the datagram that was opened with it is genuine."""
        self._taken.add(sequence)


class Opener:
    """Opens datagrams of members, of the last few sessions of each sender.

    A valid seal proves that a member made the datagram, not which one, and not when: the caller takes the
    numbers of genuine ones, and sets the present session by `adopt`.
    """

    def __init__(self, group: GroupKey) -> None:
        self._group = group
        self._senders: dict[int, list[ReceivedSession]] = {}
        """Sessions by sender: the adopted one first, then the most recently received."""
        self._adopted: dict[int, int] = {}

    def open(
        self, epoch: int, sender_hw: int, session: int | None, sequence: int, clear: bytes, box: bytes
    ) -> Opened | Refusal:
        """Open a datagram; returns its content or the reason of the refusal. `session`: None where it is
        omitted."""
        if epoch != self._group.mark:
            return Refusal.EPOCH
        known = self._senders.get(sender_hw)
        if session is None:
            if not known:
                return Refusal.UNKNOWN
            # Without a session number each known session is tried: its key opens the datagram, or none
            # does.
            for one in known:
                opened = one.open(sender_hw, sequence, clear, box)
                if opened is not Refusal.FORGED:
                    return opened
            return Refusal.FORGED
        for one in known or ():
            if one.number == session:
                return one.open(sender_hw, sequence, clear, box)
        return self._open_first(sender_hw, session, sequence, clear, box)

    def take(self, sender_hw: int, session: int, sequence: int) -> None:
        """Refuses this number of a session from now on."""
        for one in self._senders.get(sender_hw, ()):
            if one.number == session:
                one.take(sequence)

    def rekeyed(self, group: GroupKey) -> "Opener":
        """An opener for another group key that knows the same sessions: senders that change the key do not
        begin a session."""
        fresh = Opener(group)
        fresh._adopted = dict(self._adopted)
        for sender_hw, known in self._senders.items():
            fresh._senders[sender_hw] = [
                ReceivedSession(one.number, _session_key(group.key, sender_hw, one.number)) for one in known
            ]
        return fresh

    def adopt(self, sender_hw: int, session: int) -> None:
        """Set the present session of a sender, which other sessions cannot displace."""
        self._adopted[sender_hw] = session
        known = self._senders.get(sender_hw, [])
        known.sort(key=lambda one: one.number != session)

    def _open_first(
        self, sender_hw: int, session: int, sequence: int, clear: bytes, box: bytes
    ) -> Opened | Refusal:
        key = _session_key(self._group.key, sender_hw, session)
        body = key.open(_NONCE.pack(sender_hw, sequence), box, clear)
        if body is None:
            return Refusal.FORGED
        known = self._senders.get(sender_hw)
        if known is None:
            if len(self._senders) >= SENDER_LIMIT:
                # Insertion order: the sender that was opened first goes, so that the memory stays bounded.
                oldest = next(iter(self._senders))
                del self._senders[oldest]
                self._adopted.pop(oldest, None)
            known = self._senders[sender_hw] = []
        # Behind the adopted session: a replayed former session must not displace the present one.
        first = 1 if known and known[0].number == self._adopted.get(sender_hw) else 0
        known.insert(first, ReceivedSession(session, key))
        del known[SESSIONS_MAX:]
        return Opened(body, session)


def _session_key(group_key: bytes, sender_hw: int, session: int) -> SealKey:
    return SealKey(
        blake2b(
            _SESSION.pack(sender_hw, session), key=group_key, person=_TAGGED, digest_size=KEY_BYTES
        ).digest()
    )
