"""Keys of one node: its identity, the roster, and the group keys that it can open.

A folder of keys has `node.key` (the seed), `root.pub`, `roster.json` and, after a rotation, `group.keys`.
"""

import os
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from swarmware.errors import ConfigError, Denied
from swarmware.footprint.blake2b import blake2b
from swarmware.model import document
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.enrolment.token import root_digest
from swarmware.transport.security.roster import (
    Roster,
    RosterChange,
    RosterMember,
    difference,
    parse_roster,
)
from swarmware.transport.security.seal import EPOCHS, GroupKey
from swarmware.transport.sodium import KEY_BYTES, SigningKey, curve_public, open_box, sha512

T = TypeVar("T")

SEED_BYTES: Final = KEY_BYTES
FORMER_MAX: Final = EPOCHS - 1
"""Former group keys that a node keeps: with the present one each has another mark in datagrams."""
NODE_KEY: Final = "node.key"
ROOT_PUBLIC: Final = "root.pub"
ROSTER: Final = "roster.json"
FORMER_KEYS: Final = "group.keys"
GROUP_KEY: Final = "group.key"
"""The group key, in the folder of the root."""
_OPEN_GROUP: Final = b"swarmware: open loopback group"


class Keys:
    """Keys of one node; a new roster is taken while they are in use."""

    def __init__(
        self,
        platform: str,
        seed: bytes,
        roster: Roster | None,
        group: GroupKey,
        *,
        root_public: bytes = b"",
        signed: bytes = b"",
        former: tuple[GroupKey, ...] = (),
    ) -> None:
        """`signed`: the roster with the root's signature."""
        self.platform = platform
        self.roster = roster
        """The roster, or None without keys: all senders on the loopback interface are then accepted."""
        self.root_public = root_public
        self.signed = signed
        self.group = group
        """The newest group key of this node."""
        self.former = former
        """Group keys before that, the newest first."""
        self._signing = SigningKey(seed)
        self.curve_secret = _curve_secret(seed)
        self.curve_public = curve_public(self.curve_secret)
        self._index(roster)

    @classmethod
    def load(cls, directory: Path, platform: str) -> "Keys":
        """Load the keys in a node's folder.

        Raises: ConfigError when a file is missing or damaged, Denied when others can read the
        seed, the root did not sign the roster, or this platform is not on it.
        """
        seed = read_secret(directory / NODE_KEY)
        if len(seed) != SEED_BYTES:
            raise ConfigError(f"{directory / NODE_KEY}: {len(seed)} bytes, expected {SEED_BYTES}")
        root_public, source = _read(directory / ROOT_PUBLIC), directory / ROSTER
        signed = _read(source)
        roster = parse_roster(signed, root_public, str(source))
        member = roster.find(platform)
        if member is None:
            # revoked entries stay on the roster, which distinguishes a revoked platform from an unknown one
            was = any(each.platform == platform for each in roster.members)
            raise Denied(f"{source}: {platform} {'was revoked' if was else 'is not on the roster'}")
        secret = _curve_secret(seed)
        # a copied roster with another node's key would fail only later, at each neighbour
        if member.curve_public != curve_public(secret):
            raise Denied(f"{directory / NODE_KEY}: not the key that the roster has for {platform}")
        group = _open_group(roster, member, secret)
        if group is None:
            raise ConfigError(f"{source}: the group key of {platform} is not sealed to its key")
        former = _former_keys(directory / FORMER_KEYS, group.epoch)
        return cls(platform, seed, roster, group, root_public=root_public, signed=signed, former=former)

    @classmethod
    def open(cls, platform: str) -> "Keys":
        """Keys of a node without key files: an identity for this run, and a public group key."""
        group = GroupKey(0, blake2b(_OPEN_GROUP, digest_size=KEY_BYTES).digest())
        # a new identity for each start: without a roster no other node can know the old one
        return cls(platform, os.urandom(SEED_BYTES), None, group)

    @property
    def is_open(self) -> bool:
        """Whether no keys were made for this node."""
        return self.roster is None

    @property
    def swarm_mark(self) -> int:
        """The first two bytes of the fingerprint of the root, which sessions show, or 0 without keys."""
        return int.from_bytes(root_digest(self.root_public)[:2]) if self.root_public else 0

    @property
    def is_revoked(self) -> bool:
        """Whether the roster has no valid entry for this node with its present key."""
        return self.roster is not None and self.by_curve(self.curve_public) is None

    def by_curve(self, curve_public: bytes) -> RosterMember | None:
        """The member with this CURVE key, or None for an unknown or revoked one."""
        return self._by_curve.get(curve_public)

    def by_user(self, user: str) -> RosterMember | None:
        """The member that a connection was opened for, by `RosterMember.user`, or None if it was revoked."""
        return self._by_user.get(user)

    def revoked(self, curve_public: bytes) -> str:
        """The platform that had this CURVE key until it was revoked, or "" if none had."""
        return self._revoked.get(curve_public, "")

    def curve_of(self, platform: str) -> bytes | None:
        """The CURVE key of a platform on the roster, or None if it is not a member, or without a roster."""
        return self._curve_of.get(platform)

    def sign_public_of(self, platform: str) -> bytes | None:
        """The signing key of a platform on the roster, or None if it is not a member, or without a roster."""
        return self._sign_of.get(platform)

    def sign(self, data: bytes) -> bytes:
        """Ed25519 signature by this node."""
        return self._signing.sign(data)

    def apply(self, text: bytes) -> RosterChange | None:
        """Take a signed roster; returns what it changes, or None when it is not newer than the present one.

        Raises: ConfigError when it is damaged, Denied when the root did not sign it, or without keys.
        """
        before = self.roster
        if before is None:
            raise Denied(f"{self.platform} has no keys: it takes no roster")
        roster = parse_roster(text, self.root_public, "roster")
        # Rosters travel through every member: an old one must not bring a revoked platform back.
        if roster.version <= before.version:
            return None
        own = roster.find(self.platform)
        is_member = own is not None and own.curve_public == self.curve_public
        # a revoked node keeps the former key: the new one is not sealed to it
        if own is not None and is_member and roster.key_epoch != self.group.epoch:
            group = _open_group(roster, own, self.curve_secret)
            if group is None:
                raise ConfigError(f"roster {roster.version}: it has no group key for {self.platform}")
            # neighbours seal with the former key until they have the roster, too
            self.former = _kept((self.group, *self.former), group.epoch)
            self.group = group
        self.roster, self.signed = roster, text
        self._index(roster)
        return msgspec.structs.replace(difference(before, roster), revoked_self=not is_member)

    def save(self, directory: Path) -> None:
        """Write the roster and the former group keys to a node's folder. Raises: OSError."""
        self.stored().write(directory)

    def stored(self) -> "StoredRoster":
        """Content for `save` in another thread, as these keys may change before it has written."""
        return StoredRoster(self.signed, self.former)

    def _index(self, roster: Roster | None) -> None:
        valid = () if roster is None else roster.valid()
        self._by_curve = {member.curve_public: member for member in valid}
        self._by_user = {member.user: member for member in valid}
        self._curve_of = {member.platform: member.curve_public for member in valid}
        self._sign_of = {member.platform: member.sign_public for member in valid}
        members = () if roster is None else roster.members
        self._revoked = {
            each.curve_public: each.platform for each in members if each.curve_public not in self._by_curve
        }


class StoredRoster(msgspec.Struct, frozen=True):
    """The files of a roster in a node's folder."""

    signed: bytes
    former: tuple[GroupKey, ...]

    def write(self, directory: Path) -> None:
        """Write the files; a kill in between leaves keys that load. Raises: OSError."""
        if self.former:
            # before the roster: a kill in between must not lose the key that others still use
            replace_file(directory / FORMER_KEYS, msgspec.json.encode(self.former), mode=0o600)
        replace_file(directory / ROSTER, self.signed, mode=0o644)


def read_roster(path: Path, root_public: bytes) -> Roster:
    """Read and verify the roster in a file.

    Raises: ConfigError when it is damaged, Denied when the root did not sign it.
    """
    try:
        return parse_roster(path.read_bytes(), root_public, str(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error


def write_keys(directory: Path, seed: bytes, root_public: bytes, signed: bytes) -> None:
    """Make a node's folder of keys; the seed is written last, as a folder without it has no keys.

    Raises: OSError.
    """
    directory.mkdir(exist_ok=True)
    (directory / FORMER_KEYS).unlink(missing_ok=True)  # of a former swarm
    replace_file(directory / ROOT_PUBLIC, root_public, mode=0o644)
    replace_file(directory / ROSTER, signed, mode=0o644)
    replace_file(directory / NODE_KEY, seed, mode=0o600)


def _open_group(roster: Roster, member: RosterMember, curve_secret: bytes) -> GroupKey | None:
    key = open_box(member.curve_public, curve_secret, member.group_box)
    return None if key is None else GroupKey(roster.key_epoch, key)


def _kept(keys: tuple[GroupKey, ...], epoch: int) -> tuple[GroupKey, ...]:
    """Former keys whose mark in datagrams is not used by a later key, the newest first."""
    # marks in datagrams repeat after as many rotations
    former = {key.epoch: key for key in keys if epoch - FORMER_MAX <= key.epoch < epoch}
    return tuple(former[each] for each in sorted(former, reverse=True))


def read_group_key(path: Path) -> GroupKey:
    """The group key in a file. Raises: ConfigError, Denied when others can read it."""
    return _checked(path, _decode(path, read_secret(path), GroupKey))


def _former_keys(path: Path, epoch: int) -> tuple[GroupKey, ...]:
    if not path.exists():
        return ()
    keys = _decode(path, read_secret(path), tuple[GroupKey, ...])
    return _kept(tuple(_checked(path, key) for key in keys), epoch)


def _checked(path: Path, group: GroupKey) -> GroupKey:
    if len(group.key) != KEY_BYTES or group.epoch < 0:
        raise ConfigError(f"{path}: expected {KEY_BYTES} bytes and an epoch from 0")
    return group


def _curve_secret(seed: bytes) -> bytes:
    """X25519 form of an Ed25519 seed, clamped. Source: RFC 8032 section 5.1.5, RFC 7748 section 5."""
    secret = bytearray(sha512(seed)[:KEY_BYTES])
    # clamping: a multiple of the cofactor, with the highest bit at a fixed place
    secret[0] &= 248
    secret[31] = secret[31] & 127 | 64
    return bytes(secret)


def _decode(path: Path, data: bytes, cls: type[T]) -> T:
    return document.json(document.text(data, str(path)), cls, str(path))


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error


def read_secret(path: Path) -> bytes:
    """The bytes of a secret file. Raises: ConfigError, Denied when others can read it."""
    data = _read(path)
    # refused, not repaired: a key that others could read may have been copied already
    if path.stat().st_mode & 0o077:
        raise Denied(f"{path}: other users can read it; expected mode 0600")
    return data
