"""Sets a resource to a value of an operator, after the confirmation that its template requires."""

from swarmctl.confirmation import confirm
from swarmctl.session import Session
from swarmctl.tree_access import write
from swarmctl.tree_listing import consequence
from swarmctl.values import brief


async def set_resource(session: Session, path: str, text: str, *, version: int | None, yes: bool) -> None:
    """Sets a resource or a field and prints the value in force; `yes`: without a confirmation.

    Raises: as `write` and `confirm`.
    """
    full = session.path(path)
    if will := await consequence(session, full):
        confirm(yes, f"set {full}: {will}")
    done = await write(session, full, text, version)
    if session.settings.json:
        session.out.document(done)
    else:
        session.out.text(f"{done.path} = {brief(done.value)} (version {done.version})")
