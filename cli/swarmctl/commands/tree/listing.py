"""Resources as a table, and as a tree."""

from swarmctl.commands.tree.drawing import tree
from swarmctl.resources.listing import listing
from swarmctl.session.session import Session
from swarmctl.terminal.output import Column
from swarmware.types.tree import Quality


async def list_resources(session: Session, pattern: str) -> None:
    """Prints the resources that match, a line each."""
    found = await listing(session, pattern)
    if session.settings.structured:
        session.out.document(found)
        return
    rows = [
        (
            e.path,
            e.kind,
            e.type,
            e.unit,
            e.access,
            f"{e.rate_hz:g}" if e.rate_hz else None,
            None if e.age_s is None else f"{e.age_s:.2f}",
            None if e.quality is Quality.NONE else e.quality,
            e.owner,
        )
        for e in found.entries
    ]
    columns = [
        Column("PATH"),
        Column("KIND"),
        Column("TYPE"),
        Column("UNIT"),
        Column("ACCESS"),
        Column("HZ", right=True),
        Column("AGE s", right=True),
        Column("QUALITY"),
        Column("OWNER"),
    ]
    session.out.table(columns, rows)


async def draw_resources(session: Session, pattern: str) -> None:
    """Prints the resources that match below their branches."""
    found = await listing(session, pattern)
    if session.settings.structured:
        session.out.document(found)
    else:
        session.out.text("\n".join(tree(found.entries)))
