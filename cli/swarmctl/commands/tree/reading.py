"""Prints the newest values of resources."""

import msgspec

from swarmctl.resources.access import Readings, ResourceReading, read, read_all
from swarmctl.resources.fields import block, shown_fields, with_unit
from swarmctl.resources.listing import is_pattern, valued
from swarmctl.resources.owner_counter import at_owner
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import utc_text
from swarmctl.terminal.wrapping import wrapped
from swarmware.errors import Partial
from swarmware.model.names import split_field
from swarmware.types.tree import Quality, ValueSource
from swarmware.types.units import unit_of


async def print_values(session: Session, path: str, *, names: tuple[str, ...] = (), fresh: bool) -> None:
    """Prints the value of a resource or field, or of all resources that match, from their owners if `fresh`.

    `names`: fields to print of each value. Raises: Partial when some resources have no value; the error
    itself when no resource has one.
    """
    name, fields = split_field(path)
    if is_pattern(session.path(name)):
        await _print_all(session, name, fields, names, fresh=fresh)
        return
    found = await read(session, session.path(name), fields, names=names, fresh=fresh)
    if found.measured_hz is None and found.source == ValueSource.MIRROR and found.quality is not Quality.LOST:
        owned = await at_owner(session, found.path)  # the mirror does not know the rate
        found = msgspec.structs.replace(found, measured_hz=None if owned is None else owned.measured_hz)
    _warn_lost(session, found)
    if session.settings.structured:
        session.out.document(found)
    elif isinstance(found.value, dict):
        _print_block(session, found)
    else:
        session.out.text(with_unit(found.value, _unit(found, fields, names)))
        session.out.say(_about(found))


async def _print_all(
    session: Session, pattern: str, fields: str, names: tuple[str, ...], *, fresh: bool
) -> None:
    entries = await valued(session, pattern)
    found, errors = await read_all(
        session, [entry.path for entry in entries], fields, names=names, fresh=fresh
    )
    for reading in found:
        _warn_lost(session, reading)
    if session.settings.structured:
        session.out.document(Readings(found))
    else:
        width = max((len(r.path) for r in found if not isinstance(r.value, dict)), default=0)
        for reading in found:
            if isinstance(reading.value, dict):
                _print_block(session, reading)
            else:
                shown = with_unit(reading.value, _unit(reading, fields, names))
                age = "" if reading.age_s is None else f"  {reading.age_s:.3f} s old"
                session.out.text(f"{reading.path:<{width}}  {shown}{age}")
    for error in errors:
        session.out.warn(str(error))
    if errors and not found:
        raise errors[0]
    if errors:
        raise Partial(f"{pattern}: {len(errors)} of {len(entries)} have no value")


def _warn_lost(session: Session, reading: ResourceReading) -> None:
    if reading.warning:
        session.out.warn(reading.warning)


def _unit(reading: ResourceReading, fields: str, names: tuple[str, ...]) -> str:
    """Unit of a single value, from the resource or from the name of the field."""
    chosen = (names[0] if names else fields).rpartition(".")[2]
    return unit_of(chosen, whole=isinstance(reading.value, int)) if chosen else reading.unit


def _print_block(session: Session, reading: ResourceReading) -> None:
    """Prints a head with time, age and rate, then a line per field."""
    width = session.out.width
    lines = [*wrapped(_about(reading), width, "", "  "), *block(shown_fields(reading.value), width)]
    session.out.text(*lines)


def _about(reading: ResourceReading) -> str:
    when = "time unknown" if reading.utc_ns is None else utc_text(reading.utc_ns)
    age = "age unknown" if reading.age_s is None else f"{reading.age_s:.3f} s old"
    rate = "" if reading.measured_hz is None else f", {reading.measured_hz:.3g} Hz"
    return f"{reading.path}: {reading.type}, {when}, {age}{rate}, {reading.quality}, {reading.source}"
