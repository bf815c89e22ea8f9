"""The queue of missions: shows it, ends single runs, changes their priority."""

from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.table import Column
from swarmware.errors import Partial
from swarmware.types.mission import AbortAnswer, MissionAbort, MissionQueue, PriorityChange
from swarmware.types.rpc import Empty


async def print_queue(session: Session) -> None:
    """Prints the runs of the platform of the session, in the order in which they are played."""
    found = await session.ask("sys/mission/queue", Empty(), MissionQueue)
    if session.settings.structured:
        session.out.document(found)
        return
    rows = [
        (one.epoch, one.mission, one.role, one.priority, one.state, one.ordered_by, one.why)
        for one in found.runs
    ]
    columns = [
        Column("ID", right=True),
        Column("MISSION"),
        Column("ROLE"),
        Column("PRIORITY", right=True),
        Column("STATE"),
        Column("ORDERED BY"),
        Column("WHY"),
    ]
    session.out.table(columns, rows, empty=f"{found.platform}: no mission is played or waits")


async def cancel(session: Session, run_id: int, reason: str, *, yes: bool) -> None:
    """Ends a run at all its members; asks before.

    Raises: NotFound when no platform in reach plays or keeps it; Partial when a member did not acknowledge.
    """
    confirm(yes, f"cancel run {run_id}: vehicles that play it do what its on_failure says")
    answer = await session.ask("sys/mission/abort", MissionAbort(reason, "", run_id), AbortAnswer)
    _report(session, answer, f"run {run_id} cancelled")


async def prioritize(session: Session, run_id: int, priority: int) -> None:
    """Changes the priority of a run at all its members.

    Raises: as `cancel`.
    """
    change = PriorityChange(run_id, priority)
    answer = await session.ask("sys/mission/prioritize", change, AbortAnswer)
    _report(session, answer, f"run {run_id} has priority {priority}")


def _report(session: Session, answer: AbortAnswer, done: str) -> None:
    if session.settings.structured:
        session.out.document(answer)
    else:
        session.out.say(f"{done} at {', '.join(answer.acknowledged) or 'no member'}")
    if answer.silent:
        raise Partial(f"{', '.join(answer.silent)}: did not acknowledge")
