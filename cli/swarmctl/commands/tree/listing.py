"""Resources as a table, and as a tree."""

from swarmctl.commands.tree.drawing import rule_text, tree
from swarmctl.resources.listing import at_owners, listing
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Column
from swarmware.types.tree import Quality


async def list_resources(session: Session, pattern: str) -> None:
    """Prints the resources that match, a line each, with age and rate of the value at its owner."""
    found = await at_owners(session, await listing(session, pattern))
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
            None if e.measured_hz is None else f"{e.measured_hz:.3g}",
            f"{e.rate_hz:g}" if e.rate_hz else None,
            None if e.age_s is None else spoken(max(e.age_s, 0.0)),
            None if e.quality is Quality.NONE else e.quality,
            rule_text(e.rule),
            e.owner,
        )
        for e in found.entries
    ]
    columns = [
        Column("PATH"),
        Column("KIND", drop=1),
        Column("TYPE"),
        Column("UNIT", wide=True),
        Column("ACCESS", wide=True),
        Column("HZ", right=True),
        Column("DECLARED HZ", right=True, wide=True),
        Column("AGE", right=True),
        Column("QUALITY"),
        Column("RULE", wide=True),
        Column("OWNER", wide=True),
    ]
    session.out.table(columns, rows)


async def draw_resources(session: Session, pattern: str) -> None:
    """Prints the resources that match below their branches."""
    found = await at_owners(session, await listing(session, pattern))
    if session.settings.structured:
        session.out.document(found)
    else:
        session.out.text(*tree(found.entries))


async def watch_resources(session: Session, pattern: str, count: int | None) -> None:
    """Draws the resources that match again each second, with ages and rates; for programs a document each."""
    from swarmctl.resources.live_view import LiveView  # a list that is printed once has no keys

    async def draw() -> str:
        session.renew()
        found = await at_owners(session, await listing(session, pattern))
        if session.settings.structured:
            session.out.line(found)
            return ""
        return "\n".join(tree(found.entries, live=True))

    await session.check_selected(pattern)
    await LiveView(session, draw).run(count)
