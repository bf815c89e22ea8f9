"""Prints the newest values of resources."""

from swarmctl.resources.access import Readings, ResourceReading, read, read_all
from swarmctl.resources.listing import is_pattern, valued
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmware.errors import Partial


async def print_values(session: Session, path: str, *, fresh: bool) -> None:
    """Prints the value of one resource or field, or of all resources that match; `fresh`: from their owners.

    Raises: Partial when some have no value; the error itself when none has.
    """
    name, _, fields = path.partition(".")
    if is_pattern(name):
        await _print_all(session, name, fields, fresh=fresh)
        return
    found = await read(session, session.path(name), fields, fresh=fresh)
    _warn_lost(session, found)
    if session.settings.structured:
        session.out.document(found)
        return
    session.out.text(_text(found, fields))
    age = "of unknown age" if found.age_s is None else f"{found.age_s:.3f} s old"
    session.out.detail(f"{found.path}: {found.type}, {age}, {found.quality}, from {found.source}")


async def _print_all(session: Session, pattern: str, fields: str, *, fresh: bool) -> None:
    entries = await valued(session, pattern)
    found, errors = await read_all(session, [entry.path for entry in entries], fields, fresh=fresh)
    for reading in found:
        _warn_lost(session, reading)
    if session.settings.structured:
        session.out.document(Readings(found))
    else:
        width = max((len(reading.path) for reading in found), default=0)
        for reading in found:
            session.out.text(f"{reading.path:<{width}}  {_text(reading, fields)}")
    for error in errors:
        session.out.warn(str(error))
    if errors and not found:
        raise errors[0]
    if errors:
        raise Partial(f"{pattern}: {len(errors)} of {len(entries)} have no value")


def _warn_lost(session: Session, reading: ResourceReading) -> None:
    if reading.warning:
        session.out.warn(reading.warning)


def _text(reading: ResourceReading, fields: str) -> str:
    """The value with its unit; a field has no unit."""
    return brief(reading.value) + (f" {reading.unit}" if reading.unit and not fields else "")
