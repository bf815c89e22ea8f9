"""Membership of the swarm, and the encryption (sealing) of its datagrams.

A node's identity is one Ed25519 seed; its X25519 form is the node's CURVE key. The swarm's root
signs the roster, the list of members; the group key seals datagrams, with a derived key per
sender and session.
"""

import os
import struct
from collections.abc import Iterable, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from swarmware.errors import ConfigError, Denied, InvalidInput
from swarmware.model import document
from swarmware.model.access import Role
from swarmware.model.digest import blake2b
from swarmware.model.names import check_platform
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.sodium import KEY_BYTES, SealKey, SigningKey, curve_public, sha512, verify

T = TypeVar("T")

SEED_BYTES: Final = 32
REPLAY_WINDOW: Final = 64
"""Maximum reordering of datagrams; an older one is refused."""
SESSIONS_MAX: Final = 4
"""Maximum sessions of one sender in an opener: the present one and claimed successors."""
SENDER_LIMIT: Final = 4096
"""Maximum senders in an opener; only those with a valid seal are added."""
EPOCHS: Final = 16
"""Key epochs on the wire: four bits."""

_WINDOW_MASK: Final = (1 << REPLAY_WINDOW) - 1
_SESSION = struct.Struct("<IQ")
_NONCE = struct.Struct("<II4x")
_TAGGED: Final = b"swarmware tick 1"
_OPEN_GROUP: Final = b"swarmware: open loopback group"


class RosterMember(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One member of the swarm, admitted by the swarm's root."""

    platform: str
    sign_public: bytes
    """Ed25519 public key."""
    curve_public: bytes
    """X25519 public key, raw 32 bytes."""
    role: str = "node"
    """Name of the member's `access.Role`."""
    serial: int = 0


class Roster(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The members, signed by the swarm's root."""

    version: int
    members: tuple[RosterMember, ...]
    revoked: tuple[int, ...] = ()
    """Serials of revoked members."""
    key_epoch: int = 0

    def valid(self) -> tuple[RosterMember, ...]:
        """The members that are not revoked."""
        return tuple(member for member in self.members if member.serial not in self.revoked)

    def roles(self) -> dict[str, Role]:
        """Role of each valid member."""
        return {member.platform: Role.named(member.role) for member in self.valid()}

    def find(self, platform: str) -> RosterMember | None:
        """The platform's valid entry."""
        return next((member for member in self.valid() if member.platform == platform), None)


class GroupKey(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The secret of all members, with its number."""

    epoch: int
    key: bytes


class Keys:
    """Keys of one node: its identity, the roster and the group key."""

    def __init__(self, platform: str, seed: bytes, roster: Roster | None, group: GroupKey) -> None:
        self.platform = platform
        self.roster = roster
        """None: no keys were made, and all senders on the loopback interface are accepted."""
        self.group = group
        self._signing = SigningKey(seed)
        self.curve_secret = _curve_secret(seed)
        self.curve_public = _curve_public(seed)
        valid = () if roster is None else roster.valid()
        self._by_curve: dict[bytes, RosterMember] = {member.curve_public: member for member in valid}
        self._curve_of = {member.platform: member.curve_public for member in valid}

    @classmethod
    def load(cls, directory: Path, platform: str) -> "Keys":
        """Load the keys in a node's folder.

        Raises: ConfigError when a file is missing or damaged, Denied when others can read the
        seed, the root did not sign the roster, or this platform is not on it.
        """
        seed = _read_secret(directory / "node.key")
        if len(seed) != SEED_BYTES:
            raise ConfigError(f"{directory / 'node.key'}: {len(seed)} bytes, expected {SEED_BYTES}")
        group = _decode(directory / "group.key", _read_secret(directory / "group.key"), GroupKey)
        if len(group.key) != KEY_BYTES or not 0 <= group.epoch < EPOCHS:
            raise ConfigError(
                f"{directory / 'group.key'}: expected {KEY_BYTES} bytes and an epoch below {EPOCHS}"
            )
        roster = read_roster(directory / "roster.json", _read(directory / "root.pub"))
        keys = cls(platform, seed, roster, group)
        member = roster.find(platform)
        if member is None:
            raise Denied(f"{directory / 'roster.json'}: {platform} is not on the roster")
        if member.curve_public != keys.curve_public:
            raise Denied(f"{directory / 'node.key'}: not the key that the roster has for {platform}")
        return keys

    @classmethod
    def open(cls, platform: str) -> "Keys":
        """Keys of a node without key files: an identity for this run, and a public group key."""
        group = GroupKey(0, blake2b(_OPEN_GROUP, digest_size=KEY_BYTES).digest())
        return cls(platform, os.urandom(SEED_BYTES), None, group)

    @property
    def is_open(self) -> bool:
        """Whether no keys were made for this node."""
        return self.roster is None

    def by_curve(self, curve_public: bytes) -> RosterMember | None:
        """The member with this CURVE key; None for an unknown or revoked one."""
        return self._by_curve.get(curve_public)

    def curve_of(self, platform: str) -> bytes | None:
        """The CURVE key of a platform on the roster; None when it is not a member, or without a roster."""
        return self._curve_of.get(platform)

    def sign(self, data: bytes) -> bytes:
        """Ed25519 signature by this node."""
        return self._signing.sign(data)


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
    """Opens the datagrams of one session of a sender, each once."""

    __slots__ = ("_open", "_seen", "_top", "number")

    def __init__(self, number: int, key: SealKey, sequence: int) -> None:
        """`sequence`: of a datagram that was opened already; lower ones are taken within the window."""
        self.number = number
        self._open = key.open
        self._top = sequence
        self._seen = 1

    def open(self, sender_hw: int, sequence: int, clear: bytes, box: bytes) -> Opened | Refusal:
        """The body, or why it is refused: forged or replayed."""
        ahead = sequence - self._top
        if ahead <= 0 and (ahead <= -REPLAY_WINDOW or self._seen >> -ahead & 1):
            return Refusal.REPLAYED
        body = self._open(_NONCE.pack(sender_hw, sequence), box, clear)
        if body is None:
            return Refusal.FORGED
        if ahead > 0:
            self._seen = (self._seen << ahead | 1) & _WINDOW_MASK if ahead < REPLAY_WINDOW else 1
            self._top = sequence
        else:
            self._seen |= 1 << -ahead
        return Opened(body, self.number)


class Opener:
    """Opens datagrams of members: each once, of the last few sessions of each sender.

    A valid seal proves that a member made the datagram, not when: the caller determines the present
    session and sets it by `adopt`.
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
        if epoch != self._group.epoch:
            return Refusal.EPOCH
        known = self._senders.get(sender_hw)
        if session is None:
            if not known:
                return Refusal.UNKNOWN
            for one in known:
                opened = one.open(sender_hw, sequence, clear, box)
                if opened is not Refusal.FORGED:
                    return opened
            return Refusal.FORGED
        for one in known or ():
            if one.number == session:
                return one.open(sender_hw, sequence, clear, box)
        return self._open_first(sender_hw, session, sequence, clear, box)

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
                oldest = next(iter(self._senders))
                del self._senders[oldest]
                self._adopted.pop(oldest, None)
            known = self._senders[sender_hw] = []
        first = 1 if known and known[0].number == self._adopted.get(sender_hw) else 0
        known.insert(first, ReceivedSession(session, key, sequence))
        del known[SESSIONS_MAX:]
        return Opened(body, session)


def next_session(path: Path, wanted: int) -> int:
    """A session number above all earlier ones of this node, stored in a file.

    `wanted` is a wall-clock stamp; the file ensures that the number increases when that clock is set back,
    because neighbours refuse old sessions and a repeated one would repeat nonces.
    """
    try:
        before = int.from_bytes(path.read_bytes()[:8], "little")
    except FileNotFoundError:
        before = 0
    session = max(wanted, before + 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, session.to_bytes(8, "little"), mode=0o600)
    return session


def make_swarm(directory: Path, platforms: Iterable[str] | Mapping[str, str]) -> Roster:
    """Makes a swarm: its root key, and for each platform a folder that `Keys.load` takes.

    A mapping gives each platform its role. An existing folder is overwritten.
    """
    roles = dict(platforms) if isinstance(platforms, Mapping) else dict.fromkeys(platforms, "node")
    root = SigningKey(os.urandom(SEED_BYTES))
    group = GroupKey(0, os.urandom(KEY_BYTES))
    seeds = {check_platform(platform): os.urandom(SEED_BYTES) for platform in roles}
    roster = Roster(
        1,
        tuple(
            RosterMember(platform, _sign_public(seed), _curve_public(seed), roles[platform], serial)
            for serial, (platform, seed) in enumerate(seeds.items(), start=1)
        ),
    )
    signed = sign_roster(roster, root)
    directory.mkdir(parents=True, exist_ok=True)
    replace_file(directory / "root.key", root.seed, mode=0o600)
    replace_file(directory / "root.pub", root.public, mode=0o644)
    for platform, seed in seeds.items():
        folder = directory / platform
        folder.mkdir(exist_ok=True)
        replace_file(folder / "node.key", seed, mode=0o600)
        replace_file(folder / "group.key", msgspec.json.encode(group), mode=0o600)
        replace_file(folder / "root.pub", root.public, mode=0o644)
        replace_file(folder / "roster.json", signed, mode=0o644)
    return roster


def sign_roster(roster: Roster, root: SigningKey) -> bytes:
    """Encode the roster: one line of JSON, one line with the root's signature of the first."""
    body = msgspec.json.encode(roster)
    return body + b"\n" + root.sign(body).hex().encode() + b"\n"


def read_roster(path: Path, root_public: bytes) -> Roster:
    """Read and verify the roster in a file.

    Raises: ConfigError when it is damaged, Denied when the root did not sign it.
    """
    body, _, rest = _read(path).partition(b"\n")
    try:
        signature = bytes.fromhex(rest.decode("ascii").strip())
        genuine = verify(root_public, signature, body)
    except ValueError as error:
        raise ConfigError(f"{path}: expected a line of JSON and a line with its signature") from error
    if not genuine:
        raise Denied(f"{path}: not signed by this swarm's root")
    roster = _decode(path, body, Roster)
    for member in roster.members:
        try:
            Role.named(member.role)
        except ConfigError as error:
            raise ConfigError(f"{path}: {member.platform}: {error}") from None
    return roster


def _session_key(group_key: bytes, sender_hw: int, session: int) -> SealKey:
    return SealKey(
        blake2b(
            _SESSION.pack(sender_hw, session), key=group_key, person=_TAGGED, digest_size=KEY_BYTES
        ).digest()
    )


def _curve_secret(seed: bytes) -> bytes:
    """X25519 form of an Ed25519 seed, clamped. Source: RFC 8032 section 5.1.5, RFC 7748 section 5."""
    secret = bytearray(sha512(seed)[:KEY_BYTES])
    secret[0] &= 248
    secret[31] = secret[31] & 127 | 64
    return bytes(secret)


def _curve_public(seed: bytes) -> bytes:
    return curve_public(_curve_secret(seed))


def _sign_public(seed: bytes) -> bytes:
    return SigningKey(seed).public


def _decode(path: Path, data: bytes, cls: type[T]) -> T:
    return document.json(document.text(data, str(path)), cls, str(path))


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error


def _read_secret(path: Path) -> bytes:
    data = _read(path)
    if path.stat().st_mode & 0o077:
        raise Denied(f"{path}: other users can read it; expected mode 0600")
    return data
