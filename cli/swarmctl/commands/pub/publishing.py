"""Publishes values as a resource of the command itself, once or at a rate."""

from typing import Any

import msgspec

from swarmctl.resources.access import find_entry
from swarmctl.resources.classes import described_anywhere, known_class
from swarmctl.resources.entering import entered, scalar_type
from swarmctl.session.session import NAME, Session
from swarmware.errors import Conflict, Denied, InvalidInput, TypeMismatch
from swarmware.model import names
from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.module.streamwriter import StreamWriter
from swarmware.module.writer import BoardWriter
from swarmware.runtime.instant import until
from swarmware.types import registry
from swarmware.types.described import class_of
from swarmware.types.tree import TreeEntry
from swarmware.types.typed_value import check_limits


class ValuesToPublish(msgspec.Struct, frozen=True):
    """What is published, and how often."""

    words: tuple[str, ...]
    rate_hz: float | None = None
    count: int | None = None
    """Number of values, or None for one, or for no end if a rate is given."""
    type: str = ""
    """Type of a new resource, or "" for the type of the plain value."""
    kind: str = "board"
    """Kind of a new resource."""
    hold_s: float = 2.0
    """Time for which the resource remains after the last value."""


class PublishedValues(msgspec.Struct, frozen=True):
    """Values that were published."""

    path: str
    kind: Kind
    type: str
    values: int
    """Number of values."""
    duration_s: float
    """Time from the first to the last."""


async def publish(session: Session, path: str, wanted: ValuesToPublish, *, yes: bool) -> None:
    """Publishes the values and prints their number, also after an interruption (`yes`: unasked).

    Raises: Denied for a resource of another owner or platform, InvalidInput for what is not published,
    TypeMismatch and OutOfRange for a value that does not fit.
    """
    full = names.check_path(session.path(path))
    platform, local = names.split(full)
    # a resource belongs to a process on its own node, and this command runs on the joined one
    if platform != session.here:
        raise Denied(
            f"{full}: of another node; expected a path of {session.here}, or --config with the folder of the"
            f" node {platform} on its computer"
        )
    entry = await find_entry(session, full)
    _check_owner(session, full, local, entry)
    resource, value = await _described(session, full, entry, wanted)
    if entry is not None and entry.confirm:
        await session.confirm(yes, f"publish {full}: {entry.confirm}")
    # a session reads and asks: the resource belongs to a module
    async with Module(NAME, node=session.module.node) as module:
        writer = _writer(module, full, resource, type(value))
        if wanted.rate_hz is not None:
            end = "Ctrl-C ends it" if wanted.count is None else f"{wanted.count} values"
            session.out.say(f"{full}: {resource.kind}, {resource.type}, at {wanted.rate_hz:g} Hz; {end}")
        await _repeat(session, full, writer, value, wanted)


def _check_owner(session: Session, full: str, local: str, entry: TreeEntry | None) -> None:
    """Raises: Denied when the resource belongs to an application or to the template's owner, InvalidInput."""
    table = session.module.node.table
    table.refresh(probe=True)
    if (served := table.serving_path(local)) is not None or (entry and entry.kind is Kind.COMMAND):
        owner = f" of {served[0].id}" if served else ""
        raise InvalidInput(f"{full}: a command{owner}; expected `swarmctl call`")
    if entry is None:
        return
    if entry.kind is Kind.SETTING:
        raise InvalidInput(f"{full}: a setting; expected `swarmctl config set` or `tree set`")
    if entry.kind not in {Kind.BOARD, Kind.EVENT, Kind.STREAM}:
        raise InvalidInput(f"{full}: a {entry.kind}; expected a board, event or stream")
    if entry.owner not in {"", NAME}:
        raise Denied(f"{full}: belongs to {entry.owner}; expected a resource without an owner, or a new path")


async def _described(
    session: Session, full: str, entry: TreeEntry | None, wanted: ValuesToPublish
) -> tuple[Resource, msgspec.Struct]:
    """Descriptor of the resource, and the value of its type."""
    # what a former `pub` left in the tree does not determine the type of this one
    present = entry if entry is not None and entry.type and entry.owner != NAME else None
    name = present.type if present else wanted.type or scalar_type(wanted.words)
    if not name:
        raise InvalidInput(f"{full}: a new resource whose value has fields; expected --type TYPE")
    if present and wanted.type not in {"", name}:
        raise TypeMismatch(f"{full}: of type {name}; expected it, not --type {wanted.type}")
    if present or registry.installed(name):
        cls = await known_class(session, session.here, name)
    else:
        cls = class_of(await described_anywhere(session, name))
    value = entered(cls, wanted.words, full)
    known: dict[str, Any] = {"kind": Kind(wanted.kind)}
    if present:
        check_limits(present, value, full)
        known = {
            "kind": present.kind,
            "unit": present.unit,
            "range": present.range,
            "choices": present.choices,
            "description": present.description,
        }
    rate_hz = wanted.rate_hz or (present.rate_hz if present else 0.0)
    return Resource(path=names.split(full)[1], type=name, rate_hz=rate_hz, **known), value


def _writer(
    module: Module, full: str, resource: Resource, cls: type[msgspec.Struct]
) -> BoardWriter[Any] | StreamWriter[Any]:
    open_writer = module.writer if resource.kind is Kind.BOARD else module.stream_writer
    try:
        return open_writer(resource, cls)
    except Conflict as error:
        raise Denied(f"{full}: another application publishes it; expected one only") from error


async def _repeat(
    session: Session,
    full: str,
    writer: BoardWriter[Any] | StreamWriter[Any],
    value: msgspec.Struct,
    wanted: ValuesToPublish,
) -> None:
    """Writes the value once, or at its rate, and prints the published values."""
    clock = session.module.clock
    count = 1 if wanted.rate_hz is None and wanted.count is None else wanted.count
    period_ns = 1e9 / (wanted.rate_hz or 1.0)
    began_ns = last_ns = clock.now_ns()
    values = 0
    try:
        while values != count:
            # from the begin, so that delays of single values do not add up
            await until(clock, began_ns + round(values * period_ns))
            writer.write(value)
            last_ns = clock.now_ns()
            values += 1
        # the resource ends with the process, and others need time to receive its value
        await until(clock, last_ns + round(wanted.hold_s * 1e9))
    finally:
        resource = writer.resource
        done = PublishedValues(full, resource.kind, resource.type, values, (last_ns - began_ns) / 1e9)
        if session.settings.structured:
            session.out.document(done)
        else:
            times = "1 value" if values == 1 else f"{values} values in {done.duration_s:.1f} s"
            session.out.text(f"{full}: {times} of type {resource.type} published")
