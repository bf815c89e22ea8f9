"""The roster: the members of the swarm with keys and roles, signed by the swarm's root."""

from typing import Final

import msgspec

from swarmware.errors import ConfigError, Denied, SwarmError
from swarmware.model.access import Role
from swarmware.model.names import check_platform
from swarmware.transport.sodium import BOX_BYTES, KEY_BYTES, SigningKey, verify

GROUP_BOX_BYTES: Final = KEY_BYTES + BOX_BYTES
UNSIGNED_BEACONS: Final = (
    "a roster of a former version, in which not every beacon is signed; expected new keys:"
    " `swarmctl keys init --replace --root DIR` at the operator, with a new folder, then `swarmctl keys"
    " invite` there and `swarmctl keys join --replace` at each other node"
)


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
    """Number of this admission, which no other one has."""
    group_box: bytes = b""
    """The group key, sealed to `curve_public`; empty for a revoked member."""

    @property
    def user(self) -> str:
        """Key of the member as a word, which names the other end of a connection."""
        return self.curve_public.hex()


class Roster(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The members, signed by the swarm's root."""

    version: int
    """Rises with each change."""
    members: tuple[RosterMember, ...]
    revoked: tuple[int, ...] = ()
    """Serials of revoked members."""
    key_epoch: int = 0
    """Number of the group key, which rises with each rotation."""
    swarm: str = ""
    """Name of the swarm."""
    sign_beacons: bool = False
    """True in each roster: every beacon has a signature. A roster of a former version without it is refused,
    see `parse_roster`."""

    def valid(self) -> tuple[RosterMember, ...]:
        """The members that are not revoked."""
        return tuple(member for member in self.members if member.serial not in self.revoked)

    def roles(self) -> dict[str, Role]:
        """Role of each valid member."""
        return {member.platform: Role.named(member.role) for member in self.valid()}

    def find(self, platform: str) -> RosterMember | None:
        """The platform's valid entry."""
        return next((member for member in self.valid() if member.platform == platform), None)


class RosterChange(msgspec.Struct, frozen=True):
    """Changes by a new roster for the node that takes it."""

    roster: Roster
    came: tuple[RosterMember, ...] = ()
    """Members that were admitted, also those admitted again with another key."""
    gone: tuple[RosterMember, ...] = ()
    """Former entries of members that were revoked or replaced."""
    changed: tuple[RosterMember, ...] = ()
    """Members with another role."""
    rotated: bool = False
    """There is a new group key."""
    revoked_self: bool = False
    """True if this node is not a member with its present key."""

    @property
    def renamed(self) -> dict[str, str]:
        """Former name → present name of the members that proved the same key with another name."""
        # the signing key is the identity of a node; its name may change
        present = {member.sign_public: member.platform for member in self.came}
        return {
            former.platform: present[former.sign_public]
            for former in self.gone
            if present.get(former.sign_public, former.platform) != former.platform
            and self.roster.find(former.platform) is None
        }


def difference(before: Roster, after: Roster) -> RosterChange:
    """Members that were added and removed between two rosters; the caller determines `revoked_self`.

    A member is the same as long as it has the same key and name, also when it was admitted again.
    """
    former = {(member.curve_public, member.platform): member for member in before.valid()}
    present = {(member.curve_public, member.platform): member for member in after.valid()}
    return RosterChange(
        after,
        came=tuple(member for key, member in present.items() if key not in former),
        gone=tuple(member for key, member in former.items() if key not in present),
        changed=tuple(
            member for key, member in present.items() if key in former and former[key].role != member.role
        ),
        rotated=after.key_epoch != before.key_epoch,
    )


def sign_roster(roster: Roster, root: SigningKey) -> bytes:
    """Encode the roster: one line of JSON, one line with the root's signature of the first."""
    body = msgspec.json.encode(roster)
    return join_signed(body, root.sign(body))


def join_signed(body: bytes, signature: bytes) -> bytes:
    """The text of a roster: its line of JSON, and the line with the signature."""
    return body + b"\n" + signature.hex().encode() + b"\n"


def split_signed(text: bytes, source: str) -> tuple[bytes, bytes]:
    """The line of JSON and the signature of a roster's text. Raises: ConfigError for any other text."""
    body, _, rest = text.partition(b"\n")
    try:
        return body, bytes.fromhex(rest.decode("ascii").strip())
    except ValueError as error:
        raise ConfigError(f"{source}: expected a line of JSON and a line with its signature") from error


def parse_roster(text: bytes, root_public: bytes, source: str) -> Roster:
    """Decode and verify the text of a roster.

    Raises: ConfigError when it is damaged or of a former version, Denied when the root did not sign it.
    """
    # Verified before it is decoded: bytes without the root's signature reach no parser.
    body, signature = split_signed(text, source)
    try:
        genuine = verify(root_public, signature, body)
    except ValueError as error:
        raise ConfigError(f"{source}: the root's public key: {error}") from error
    if not genuine:
        raise Denied(f"{source}: not signed by this swarm's root")
    try:
        roster = msgspec.json.decode(body, type=Roster)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise ConfigError(f"{source}: {error}") from error
    if not roster.sign_beacons:
        raise ConfigError(f"{source}: {UNSIGNED_BEACONS}")
    serials = set[int]()
    for member in roster.members:
        try:
            _check(member)
        except SwarmError as error:
            raise ConfigError(f"{source}: {member.platform}: {error}") from None
        # a revoked serial would revoke both of its members
        if member.serial in serials:
            raise ConfigError(f"{source}: {member.platform}: serial {member.serial} is used twice")
        serials.add(member.serial)
    # revoked entries may repeat the name of a valid one
    valid = [member.platform for member in roster.valid()]
    # with two valid entries the role would depend on their order
    if len(set(valid)) != len(valid):
        twice = next(name for name in valid if valid.count(name) > 1)
        raise ConfigError(f"{source}: {twice}: two valid entries, expected one")
    return roster


def _check(member: RosterMember) -> None:
    check_platform(member.platform)
    Role.named(member.role)
    for key in (member.sign_public, member.curve_public):
        if len(key) != KEY_BYTES:
            raise ConfigError(f"a key of {len(key)} bytes, expected {KEY_BYTES}")
    if len(member.group_box) not in (0, GROUP_BOX_BYTES):
        raise ConfigError(f"a group_box of {len(member.group_box)} bytes, expected {GROUP_BOX_BYTES}")
