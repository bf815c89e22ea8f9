"""The runs that a platform has played: the list, and one run with its steps."""

import json

import msgspec

from swarmctl.session.each_node import ResourceAbsent
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import utc_text
from swarmctl.terminal.table import Column
from swarmware.errors import NotFound
from swarmware.types.mission_run import MissionHistory, RunDetails, RunRequest
from swarmware.types.rpc import Empty


async def print_history(session: Session) -> None:
    """Prints the runs of the platform of the session, newest first."""
    found = await session.ask("sys/mission/history", Empty(), MissionHistory)
    if session.settings.structured:
        session.out.document(found)
        return
    rows = [
        (
            one.epoch,
            utc_text(one.began_utc_ns),
            one.mission,
            one.role,
            one.outcome,
            one.ordered_by,
            one.reason,
        )
        for one in found.runs
    ]
    columns = [
        Column("ID", right=True),
        Column("BEGAN"),
        Column("MISSION"),
        Column("ROLE"),
        Column("OUTCOME"),
        Column("ORDERED BY"),
        Column("REASON"),
    ]
    session.out.table(columns, rows, empty=f"{found.platform}: no run is recorded")
    if found.failed_writes:
        session.out.warn(
            f"{found.platform}: {found.failed_writes} writes of runs failed, the last one: {found.failure}"
        )


async def print_run(session: Session, run_id: int) -> None:
    """Prints one run of the platform of the session.

    Raises: ResourceAbsent when the platform has not played it, or does not keep it any more.
    """
    try:
        found = await session.ask("sys/mission/run", RunRequest(run_id), RunDetails)
    except NotFound as error:
        raise ResourceAbsent(str(error)) from error
    if session.settings.structured:
        session.out.document(found)
        return
    summary, record = found.summary, found.record
    ended = utc_text(summary.ended_utc_ns) if summary.ended_utc_ns else "–"
    rows = [
        ("run", f"{record.epoch}, {summary.folder}"),
        ("mission", f"{record.mission}, hash {record.hash[:8]}, file {record.file}"),
        ("role", record.role),
        ("parameters", json.dumps(msgspec.to_builtins(record.params))),
        ("priority", str(record.priority)),
        ("members", ", ".join(f"{member.platform} ({member.role})" for member in record.members)),
        ("ordered by", f"{record.ordered_by or 'unknown'}, from {record.issuer}"),
        ("findings", "; ".join(record.findings) or "none"),
        ("began", utc_text(summary.began_utc_ns)),
        ("ended", ended),
        ("outcome", ": ".join(filter(None, (summary.outcome, record.reason)))),
        ("log", ", ".join(record.log.segments) or "no segments"),
    ]
    session.out.table([Column("KEY"), Column("VALUE")], rows)
    steps = [
        (f"{(step.at_ns - record.log.first_ns) / 1e9:.3f}", step.block, step.type, step.event, step.text)
        for step in found.progress
    ]
    columns = [
        Column("AFTER s", right=True),
        Column("BLOCK"),
        Column("TYPE"),
        Column("EVENT"),
        Column("SAYS"),
    ]
    session.out.table(columns, steps, empty="no step is recorded")
    if record.left_out:
        session.out.say(f"{record.left_out} steps were left out: the progress had reached its maximum size")
