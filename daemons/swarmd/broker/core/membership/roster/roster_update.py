"""Messages about the roster between neighbours, in frames of kind ROSTER; the difference of two rosters."""

from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.transport.security.roster import (
    GROUP_BOX_BYTES,
    Roster,
    RosterMember,
    join_signed,
    split_signed,
)


class RosterOffer(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """The sender has this version; for a node that cannot read its beacons."""

    version: int
    port: int
    """Port of the sender's ZeroMQ socket, at the address of the connection."""


class RosterQuestion(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """The sender has this version, and asks for a newer one."""

    have: int
    """Version that the sender has, or 0 to ask for the whole roster."""
    port: int


class RosterUpdate(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """A newer roster: the whole text, or the difference from a version that the receiver has."""

    base: int
    """0: the whole roster is in `whole`."""
    whole: bytes = b""
    version: int = 0
    key_epoch: int = 0
    swarm: str = ""
    revoked: tuple[int, ...] = ()
    members: tuple[RosterMember, ...] = ()
    """Members that are new or have changed, without `group_box` when all of them follow in `boxes`."""
    removed: tuple[int, ...] = ()
    """Serials of the entries that are left out."""
    boxes: bytes = b""
    """After a rotation: the `group_box` of each valid member, in their order."""
    signature: bytes = b""


RosterMessage = RosterOffer | RosterQuestion | RosterUpdate

_DECODER: Final = msgspec.msgpack.Decoder(RosterMessage)


def encode(message: RosterMessage) -> bytes:
    """Encode a message as the payload of a frame."""
    return msgspec.msgpack.encode(message)


def decode(payload: bytes | memoryview) -> RosterMessage:
    """Decode the payload of a frame of kind ROSTER. Raises: WireError."""
    try:
        message: RosterMessage = _DECODER.decode(payload)
        return message
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise WireError(f"message about the roster: {error}") from error


def make_update(base: Roster | None, after: Roster, signed: bytes) -> RosterUpdate:
    """The update for a receiver that has `base`; the whole roster where that is unknown or not smaller."""
    if base is None:
        return RosterUpdate(0, signed)
    body, signature = split_signed(signed, "roster")
    rotated = after.key_epoch != base.key_epoch
    known = {member.serial: _bare(member, rotated) for member in base.members}
    kept = {member.serial for member in after.members}
    gone = frozenset(after.revoked)
    update = RosterUpdate(
        base.version,
        b"",
        after.version,
        after.key_epoch,
        after.swarm,
        after.revoked,
        tuple(bare for each in after.members if known.get(each.serial) != (bare := _bare(each, rotated))),
        tuple(serial for serial in known if serial not in kept),
        b"".join(member.group_box for member in after.members if member.serial not in gone)
        if rotated
        else b"",
        signature,
    )
    if _merged_body(base, update) != body:
        return RosterUpdate(0, signed)  # the root encodes it in another way
    return update


def merge(base: Roster, update: RosterUpdate) -> bytes:
    """The text of the roster that an update leads to; the root's signature in it decides.

    Raises: WireError when it does not fit the base.
    """
    if not update.base:
        return update.whole
    if update.base != base.version:
        raise WireError(f"roster: a difference from version {update.base}, here is {base.version}")
    body = _merged_body(base, update)
    if body is None:
        raise WireError(
            f"roster {update.version}: {len(update.boxes)} bytes of group keys do not fit its members"
        )
    return join_signed(body, update.signature)


def _merged_body(base: Roster, update: RosterUpdate) -> bytes | None:
    fresh = {member.serial: member for member in update.members}
    removed = frozenset(update.removed)
    kept = [fresh.pop(each.serial, each) for each in base.members if each.serial not in removed]
    members = [*kept, *fresh.values()]
    if update.key_epoch != base.key_epoch:
        gone, boxes = frozenset(update.revoked), update.boxes
        valid = sum(member.serial not in gone for member in members)
        if len(boxes) != valid * GROUP_BOX_BYTES:
            return None
        parts = iter(boxes[at : at + GROUP_BOX_BYTES] for at in range(0, len(boxes), GROUP_BOX_BYTES))
        members = [
            msgspec.structs.replace(member, group_box=b"" if member.serial in gone else next(parts))
            for member in members
        ]
    roster = Roster(update.version, tuple(members), update.revoked, update.key_epoch, update.swarm, True)
    return msgspec.json.encode(roster)


def _bare(member: RosterMember, rotated: bool) -> RosterMember:
    return msgspec.structs.replace(member, group_box=b"") if rotated else member
