"""The root of a swarm: the key that signs the roster, and the changes of the roster.

The root's folder has `root.key` (the seed), `root.pub`, `roster.json` and `group.key`, its group key.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import ConfigError, Conflict, Denied, NotFound
from swarmware.model.access import Role
from swarmware.model.names import check_platform
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.enrolment.token import proof_of, proves, root_digest
from swarmware.transport.security.keys import (
    GROUP_KEY,
    ROOT_PUBLIC,
    ROSTER,
    SEED_BYTES,
    read_group_key,
    read_roster,
    read_secret,
    write_keys,
)
from swarmware.transport.security.roster import Roster, RosterMember, sign_roster
from swarmware.transport.security.seal import GroupKey
from swarmware.transport.sodium import KEY_BYTES, SigningKey, curve_of_signing, seal_box

ROOT_KEY: Final = "root.key"
FORMER_KEYS_MAX: Final = 3
"""Replaced keys of a platform that the roster keeps."""


class Candidate(msgspec.Struct, frozen=True):
    """A platform that is to be admitted."""

    platform: str
    role: str
    sign_public: bytes
    """Ed25519 public key that it made."""
    proof: bytes
    """Signature of the request by the platform's key, see `proof_of`."""


class Root:
    """Makes the rosters of a swarm; each change is in its folder before it is returned."""

    def __init__(self, directory: Path, key: SigningKey, roster: Roster, group: GroupKey | None) -> None:
        self._directory = directory
        self._key = key
        self.roster = roster
        self._group = group

    @classmethod
    def make(cls, directory: Path, swarm: str = "", *, replace: bool = False) -> "Root":
        """Make a root and its folder. `replace`: an existing one is overwritten.

        Raises: Conflict when there is one, OSError.
        """
        if (directory / ROOT_KEY).exists() and not replace:
            raise Conflict(f"{directory / ROOT_KEY}: there is a root already")
        directory.mkdir(parents=True, exist_ok=True)
        key = SigningKey(os.urandom(SEED_BYTES))
        # version 0 is never distributed: the first admission makes version 1
        first = Roster(0, (), swarm=swarm, sign_beacons=True)
        root = cls(directory, key, first, GroupKey(0, os.urandom(KEY_BYTES)))
        replace_file(directory / ROOT_PUBLIC, key.public, mode=0o644)
        root._save(root.roster)
        # the seed last: a folder without it counts as no root, and `make` can be repeated
        replace_file(directory / ROOT_KEY, key.seed, mode=0o600)
        return root

    @classmethod
    def load(cls, directory: Path) -> "Root":
        """Load the root in a folder.

        Raises: ConfigError when a file is missing or damaged, Denied when others can read the
        seed, or the root did not sign the roster.
        """
        path = directory / ROOT_KEY
        seed = read_secret(path)
        if len(seed) != SEED_BYTES:
            raise ConfigError(f"{path}: {len(seed)} bytes, expected {SEED_BYTES}")
        key = SigningKey(seed)
        roster = read_roster(directory / ROSTER, key.public)
        group = read_group_key(directory / GROUP_KEY) if (directory / GROUP_KEY).exists() else None
        if group is not None and group.epoch != roster.key_epoch:
            group = None  # a kill between two files: the next change rotates
        return cls(directory, key, roster, group)

    @property
    def public(self) -> bytes:
        """The public key of the root."""
        return self._key.public

    @property
    def signed(self) -> bytes:
        """The present roster with the root's signature."""
        return sign_roster(self.roster, self._key)

    def admit(self, *candidates: Candidate) -> bytes:
        """Admit platforms; a member that comes with another key replaces its former entry, and the group
        key is rotated. A key that comes with another name ends its former name. The roster keeps the last
        keys that were replaced, so that a node that returns with one learns of it. Returns the signed roster.

        Raises: InvalidInput for a wrong name, role or key, Denied when one has not proven its key.
        """
        before, last = self.roster, self._last_serial()
        members, revoked = list(before.members), list(before.revoked)
        rotate = self._group is None
        for serial, candidate in enumerate(candidates, start=last + 1):
            fresh = _member(candidate, serial, self.public)
            former = before.find(candidate.platform)
            if former is not None:
                # the serial, not the name: the platform returns under the same name with a new serial
                revoked.append(former.serial)
                # The holder of the former key still knows the group key.
                rotate = rotate or former.sign_public != candidate.sign_public
            renamed = [
                each
                for each in before.valid()
                if each.sign_public == candidate.sign_public and each.platform != candidate.platform
            ]
            revoked += [each.serial for each in renamed]
            left = {candidate.platform, *(each.platform for each in renamed)}
            former_keys = _former_keys(members, candidate)
            # entries are replaced, so that the roster does not grow with each admission
            members = [each for each in members if each.platform not in left]
            members += [*former_keys, fresh]
        return self._next(members, revoked, rotate=rotate)

    def revoke(self, *platforms: str) -> bytes:
        """Revoke members and rotate the group key; returns the signed roster.

        Raises: NotFound for a platform that is not a valid member.
        """
        revoked = list(self.roster.revoked)
        for platform in platforms:
            member = self.roster.find(platform)
            if member is None:
                there = ", ".join(each.platform for each in self.roster.valid())
                raise NotFound(f"{platform} is not a member of the swarm; expected one of {there}")
            revoked.append(member.serial)
        return self._next(list(self.roster.members), revoked, rotate=True)

    def rotate(self) -> bytes:
        """Make a new group key; returns the signed roster."""
        return self._next(list(self.roster.members), list(self.roster.revoked), rotate=True)

    def _next(self, members: list[RosterMember], revoked: list[int], *, rotate: bool) -> bytes:
        epoch, group = self.roster.key_epoch, self._group
        if rotate or group is None:
            epoch += 1
            self._group = group = GroupKey(epoch, os.urandom(KEY_BYTES))
            # all boxes hold the former key; they are sealed again below
            members = [msgspec.structs.replace(member, group_box=b"") for member in members]
        gone = frozenset(revoked)
        sealed = tuple(
            member
            # an unchanged box is kept: sealing is random, and would change the whole roster
            if member.group_box or member.serial in gone
            else msgspec.structs.replace(member, group_box=seal_box(member.curve_public, group.key))
            for member in members
        )
        version = self.roster.version + 1
        self._save(Roster(version, sealed, tuple(sorted(gone)), epoch, self.roster.swarm, True))
        return self.signed

    def _last_serial(self) -> int:
        """Highest serial that was ever assigned, also to revoked members."""
        roster = self.roster
        return max((*roster.revoked, *(member.serial for member in roster.members)), default=0)

    def _save(self, roster: Roster) -> None:
        # the key before the roster that names its epoch; `load` detects a kill in between
        if self._group is not None:
            replace_file(self._directory / GROUP_KEY, msgspec.json.encode(self._group), mode=0o600)
        replace_file(self._directory / ROSTER, sign_roster(roster, self._key), mode=0o644)
        self.roster = roster


def candidate(platform: str, role: str, seed: bytes, root_public: bytes) -> Candidate:
    """The candidate with this seed."""
    key = SigningKey(seed)
    return Candidate(platform, role, key.public, proof_of(key, root_digest(root_public), platform))


def make_swarm(directory: Path, platforms: Iterable[str] | Mapping[str, str], swarm: str = "") -> Roster:
    """Makes a swarm: its root, and for each platform a folder that `Keys.load` takes.

    A mapping gives each platform its role; the swarm has the name of the folder unless it is given. An
    existing folder is overwritten.
    """
    roles = dict(platforms) if isinstance(platforms, Mapping) else dict.fromkeys(platforms, "node")
    seeds = {check_platform(platform): os.urandom(SEED_BYTES) for platform in roles}
    root = Root.make(directory, swarm or directory.name, replace=True)
    # all together: one version of the roster, and one group key
    signed = root.admit(
        *(candidate(platform, roles[platform], seed, root.public) for platform, seed in seeds.items())
    )
    for platform, seed in seeds.items():
        write_keys(directory / platform, seed, root.public, signed)
    return root.roster


def _former_keys(members: list[RosterMember], candidate: Candidate) -> list[RosterMember]:
    """The newest roster entries of a platform with other keys than its present one."""
    former = [
        msgspec.structs.replace(each, group_box=b"")
        for each in members
        if each.platform == candidate.platform and each.sign_public != candidate.sign_public
    ]
    return former[-FORMER_KEYS_MAX:]


def _member(candidate: Candidate, serial: int, root_public: bytes) -> RosterMember:
    platform = check_platform(candidate.platform)
    Role.named(candidate.role)
    public = candidate.sign_public
    if not proves(public, candidate.proof, root_digest(root_public), platform):
        raise Denied(f"{platform}: it has not proven its key")
    return RosterMember(platform, public, curve_of_signing(public), candidate.role, serial)
