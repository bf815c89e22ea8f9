"""Live settings of a platform: the resources below `config/`."""

from swarmctl.output import Column
from swarmctl.session import Session
from swarmctl.tree_access import read_all
from swarmctl.tree_listing import is_pattern, valued
from swarmctl.values import brief
from swarmware.errors import NotFound


async def print_settings(session: Session, key: str) -> None:
    """Prints one setting, or all that match with unit, range and version.

    Raises: NotFound when none matches.
    """
    await session.reach(session.platform)
    try:
        entries = await valued(session, f"config/{key}")
    except NotFound as error:
        if is_pattern(key):
            raise NotFound(f"{session.platform}: no live setting matches {key!r}") from error
        raise
    readings, errors = await read_all(session, [entry.path for entry in entries])
    if errors:
        raise errors[0]
    limits = {entry.path: entry.range for entry in entries}
    if session.settings.json:
        found = [
            {
                "path": r.path,
                "value": r.value,
                "unit": r.unit,
                "range": limits[r.path],
                "version": r.version,
            }
            for r in readings
        ]
        session.out.document({"settings": found})
    elif not is_pattern(key):
        session.out.text(brief(readings[0].value))
    else:
        rows = []
        for r in readings:
            limit = limits[r.path]
            shown = f"{limit[0]:g}..{limit[1]:g}" if limit else None
            rows.append((r.path, brief(r.value), r.unit, shown, r.version))
        columns = [Column("PATH"), Column("VALUE"), Column("UNIT"), Column("RANGE"), Column("VERSION")]
        session.out.table(columns, rows)
