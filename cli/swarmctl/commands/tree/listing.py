"""Resources as a table, and as a tree."""

from swarmctl.commands.tree.drawing import rule_text, tree
from swarmctl.resources.listing import at_owners, listing
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Detail, rows_of
from swarmware.types.tree import Quality, TreeEntry


async def list_resources(session: Session, pattern: str) -> None:
    """Prints the resources that match, a line each, with age and rate of the value at its owner."""
    found = await at_owners(session, await listing(session, pattern))
    if session.settings.structured:
        session.out.document(found)
        return
    details: list[Detail[TreeEntry]] = [
        Detail("PATH", value=lambda entry: entry.path),
        Detail("KIND", value=lambda entry: entry.kind, drop=1),
        Detail("TYPE", value=lambda entry: entry.type),
        Detail("UNIT", value=lambda entry: entry.unit, wide=True),
        Detail("ACCESS", value=lambda entry: entry.access, wide=True),
        Detail(
            "HZ",
            value=lambda entry: None if entry.measured_hz is None else f"{entry.measured_hz:.3g}",
            right=True,
        ),
        Detail(
            "DECLARED HZ",
            value=lambda entry: f"{entry.rate_hz:g}" if entry.rate_hz else None,
            right=True,
            wide=True,
        ),
        Detail(
            "AGE",
            value=lambda entry: None if entry.age_s is None else spoken(max(entry.age_s, 0.0)),
            right=True,
        ),
        Detail("QUALITY", value=lambda entry: None if entry.quality is Quality.NONE else entry.quality),
        Detail("RULE", value=lambda entry: rule_text(entry.rule), wide=True),
        Detail("OWNER", value=lambda entry: entry.owner, wide=True),
    ]
    session.out.table(details, rows_of(details, found.entries))


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
        # routes are requested once per session, and a platform may come or go between two drawings
        session.renew()
        found = await at_owners(session, await listing(session, pattern))
        if session.settings.structured:
            session.out.line(found)
            return ""
        return "\n".join(tree(found.entries, live=True))

    await session.check_selected(pattern)
    await LiveView(session, draw).run(count)
