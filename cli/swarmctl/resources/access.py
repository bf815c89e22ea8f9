"""Reads and writes values of the resource tree."""

import asyncio
from typing import Any

import msgspec

from swarmctl.resources.classes import payload_class
from swarmctl.resources.entering import json_or_text
from swarmctl.resources.fields import attitudes
from swarmctl.resources.listing import ask_value
from swarmctl.resources.newest import newest
from swarmctl.resources.values import brief, decoded, select
from swarmctl.session.session import Session
from swarmware.errors import NoAnswer, NotFound, SwarmError
from swarmware.model import names, paths
from swarmware.model.clock import utc_ns
from swarmware.model.names import join, split
from swarmware.types.tree import (
    Quality,
    TreeEntry,
    TreeList,
    TreeListing,
    TreeReset,
    TreeSet,
    TreeSetDone,
    TreeUndo,
)


class ResourceReading(msgspec.Struct, frozen=True):
    """The newest value of a resource, with its quality."""

    path: str
    type: str
    unit: str
    value: Any
    """Plain data of the value, or of the requested field."""
    stamp_ns: int
    """Hardware clock of the owner."""
    age_s: float | None
    """Age of the value, or None if the owner's clock is not known here."""
    sequence: int
    version: int
    quality: Quality
    """live | stale | lost."""
    owner: str
    source: str
    """own | mirror | asked."""
    utc_ns: int | None = None
    """Stamp on the wall clock of this machine, or None if the owner's clock is not known here."""
    measured_hz: float | None = None
    """Rate at which the owner has written the newest values, or None if unknown."""
    angles: dict[str, dict[str, float]] = {}
    """Roll, pitch and yaw in degrees of each quaternion, by the name before its components."""

    @property
    def warning(self) -> str:
        """Warning to print with the value, or "" if it needs none."""
        if self.quality is not Quality.LOST:
            return ""
        age = "of unknown age" if self.age_s is None else f"{self.age_s:.0f} s old"
        return f"{self.path}: lost; this is the last value, {age}"


class Readings(msgspec.Struct, frozen=True):
    """The newest values of resources that match a pattern."""

    values: list[ResourceReading]


class WriteResult(msgspec.Struct, frozen=True):
    """A value that was set."""

    path: str
    type: str
    value: Any
    version: int
    applied_by: tuple[str, ...] = ()
    """Applications in which the value of a setting is in force."""
    awaited: tuple[str, ...] = ()
    """Applications with the setting that have not confirmed it in time."""

    @property
    def details(self) -> str:
        """Version, and the applications that have taken a setting."""
        return ", ".join((f"version {self.version}", *(f"in force in {name}" for name in self.applied_by)))

    def check_applied(self) -> None:
        """Check that every application with the setting confirmed it. Raises: NoAnswer."""
        if self.awaited:
            names = ", ".join(self.awaited)
            raise NoAnswer(
                f"{self.path}: stored as version {self.version}, but {names} has not taken it: expected its"
                " confirmation; `swarmctl app ls` shows whether it works"
            )


async def read(
    session: Session, path: str, fields: str = "", *, names: tuple[str, ...] = (), fresh: bool = False
) -> ResourceReading:
    """Newest value of a resource, reduced to the field `fields` and to its fields in `names`, if given.

    Raises: NotFound, NoAnswer, InvalidInput for an unknown field.
    """
    platform, local = split(path)
    if not local:
        raise NotFound(f"{path}: a platform has no value; `swarmctl tree ls {path}` shows its resources")
    found = await newest(session, path, fresh=fresh)
    cls = await payload_class(session, platform or session.here, found.type)
    value = select(decoded(cls, found.data), found.path, fields, names)
    return ResourceReading(
        found.path,
        found.type,
        found.unit,
        value,
        found.stamp_ns,
        found.age_s,
        found.sequence,
        found.version,
        found.quality,
        found.owner,
        found.source,
        # by the age: the owner's stamp is on its own clock, which does not run in UTC
        None if found.age_s is None else utc_ns() - round(found.age_s * 1e9),
        found.measured_hz,
        {name: angles._asdict() for name, angles in attitudes(value).items()},
    )


async def read_all(
    session: Session,
    paths: list[str],
    fields: str = "",
    *,
    names: tuple[str, ...] = (),
    fresh: bool = False,
) -> tuple[list[ResourceReading], list[SwarmError]]:
    """Values of the readable resources, and the errors of the unreadable ones."""

    async def one(path: str) -> ResourceReading | SwarmError:
        try:
            return await read(session, path, fields, names=names, fresh=fresh)
        except SwarmError as error:
            return error

    found = await asyncio.gather(*(one(path) for path in paths))
    readings = [reading for reading in found if isinstance(reading, ResourceReading)]
    return readings, [error for error in found if isinstance(error, SwarmError)]


async def write(session: Session, path: str, text: str, version: int | None = None) -> WriteResult:
    """Sets a resource, or a field of it, to what an operator typed.

    Raises: NotFound, NoAnswer, Denied, TypeMismatch, OutOfRange, Conflict when the version is another.
    """
    request = TreeSet(path, msgspec.msgpack.encode(json_or_text(text)), version)
    done = await _ask_owner(session, "set", path, request)
    return await _written(session, done)


async def _ask_owner(session: Session, verb: str, path: str, request: msgspec.Struct) -> TreeSetDone:
    """Asks the platform of a resource for a change, which it grants by the rights of this session."""
    # to the owner itself, since mirrors are read-only
    platform = split(path)[0] or session.here
    return await session.ask(join(platform, paths.tree_request(verb)), request, TreeSetDone, about=path)


async def _written(session: Session, done: TreeSetDone) -> WriteResult:
    platform = split(done.path)[0] or session.here
    cls = await payload_class(session, platform, done.type)
    value = decoded(cls, done.data)
    return WriteResult(done.path, done.type, value, done.version, done.applied_by, done.awaited)


async def set_resource(session: Session, path: str, text: str, *, version: int | None, yes: bool) -> None:
    """Sets a resource or a field and prints the value in force; `yes`: without a confirmation.

    Raises: as `confirm_change` and `write`; NoAnswer when an application with the setting has not
    taken it.
    """
    full = session.path(path)
    await confirm_change(session, full, f"set {split(full)[1]}", yes=yes)
    done = await write(session, full, text, version)
    if session.settings.structured:
        session.out.document(done)
    else:
        session.out.text(f"{done.path} = {brief(done.value)} ({done.details})")
    done.check_applied()


async def undo(session: Session, path: str) -> WriteResult:
    """Restores the value that a setting had before its last change.

    Raises: NotFound when it was not changed, InvalidInput when it is not a setting, NoAnswer, Denied.
    """
    done = await _ask_owner(session, "undo", path, TreeUndo(path))
    return await _written(session, done)


async def reset(session: Session, path: str) -> WriteResult:
    """Removes the override of a setting: its file, else its default, is in force.

    Raises: NotFound, InvalidInput when it is not a setting, NoAnswer, Denied.
    """
    done = await _ask_owner(session, "reset", path, TreeReset(path))
    return await _written(session, done)


async def entry_of(session: Session, path: str) -> TreeEntry:
    """The resource of any kind at a path.

    Raises: NotFound with similar paths, NoAnswer when the platform is not reachable.
    """
    full = names.check_path(session.path(path))
    entry = await _exact(session, full)
    if entry is None:
        # the error of its tree names similar paths
        await ask_value(session, full)
        raise NotFound(f"{full}: no such resource; expected a path that `swarmctl tree ls` shows")
    return entry


async def find_entry(session: Session, path: str) -> TreeEntry | None:
    """The resource of any kind at a path, or None if none is known now.

    Raises: InvalidInput for a malformed path.
    """
    full = names.check_path(session.path(path))
    platform = names.split(full)[0] or session.here
    entry = await _listed(session, session.here, full)
    if entry is not None or platform == session.here:
        return entry
    try:
        return await _listed(session, platform, full)
    except (NotFound, NoAnswer):
        # not raised: a caller that waits for a resource must also wait for its platform
        return None  # its platform is not known yet, or has no route


async def _exact(session: Session, full: str) -> TreeEntry | None:
    """The resource at a global path, or None if it does not exist.

    Raises: NotFound, NoAnswer for a platform that is unknown or not reachable.
    """
    platform = names.split(full)[0] or session.here
    await session.reach(platform)
    entry = await _listed(session, session.here, full)
    if entry is None and platform != session.here:
        # its own platform knows a new resource first
        entry = await _listed(session, platform, full)
    return entry


async def _listed(session: Session, platform: str, full: str) -> TreeEntry | None:
    """The resource as the tree of a platform lists it, or None if that tree has no such resource."""
    found = await session.ask(join(platform, "sys/tree/list"), TreeList(full, 1), TreeListing)
    return found.entries[0] if found.entries else None


async def consequence(session: Session, path: str) -> str:
    """Effect of setting the resource or a field, from its template, or "" if it needs no confirmation."""
    platform, local = names.split(names.check_path(names.split_field(path)[0]))
    entry = await _exact(session, names.join(platform or session.here, local))
    return "" if entry is None else entry.confirm


async def confirm_change(session: Session, path: str, change: str, *, yes: bool) -> None:
    """Returns when the operator confirms the effect of a change that its template states; at once if `yes`.

    Raises: where a command runs for several nodes, ResourceAbsent when this one has no such resource;
    NoAnswer when it is not reachable; as `Session.confirm`.
    """
    full = names.check_path(names.split_field(path)[0])
    will = ""
    if session.joint or not yes:
        # one look-up for both: whether the resource is there, and the text of the confirmation
        entry = await _exact(session, full)
        if session.joint and entry is None:
            from swarmctl.session.each_node import ResourceAbsent  # a command for one node needs none of it

            raise ResourceAbsent(f"{full}: no such resource; expected a path that `swarmctl tree ls` shows")
        will = "" if yes or entry is None else entry.confirm
    await session.confirm(yes, will and f"{change}: {will}")
