"""Missions in the store of a ground station, and the state of the active one."""

from swarmctl.commandline import word_cache
from swarmctl.session.session import Session, config_dir
from swarmctl.terminal.table import Column
from swarmware.model import names
from swarmware.types.mission import MissionList, MissionState, MissionStatus
from swarmware.types.reaction import ReactionPhase
from swarmware.types.rpc import Empty


async def list_missions(session: Session) -> None:
    """Prints the missions in the store of the platform of the session."""
    found = await session.ask("sys/mission/ls", Empty(), MissionList)
    word_cache.save(str(config_dir(session.settings)), missions=[m.name for m in found.missions])
    if session.settings.structured:
        session.out.document(found)
        return
    rows = [(m.name, m.title, m.hash[:8], ", ".join(m.roles), m.sound, m.findings) for m in found.missions]
    columns = [
        Column("MISSION"),
        Column("TITLE"),
        Column("HASH"),
        Column("ROLES"),
        Column("SOUND"),
        Column("FINDINGS", right=True),
    ]
    empty = f"{session.platform}: no missions in its store; `swarmctl new mission NAME` makes one"
    session.out.table(columns, rows, empty=empty)


async def print_status(session: Session) -> None:
    """Prints the mission state of the platform of the session, and of the members that it receives."""
    found = await session.ask("sys/mission/status", Empty(), MissionStatus)
    if session.settings.structured:
        session.out.document(found)
    else:
        _show(session, found)


def _rows(found: MissionStatus) -> list[tuple[str, MissionState]]:
    states = {found.platform: found.state, **found.others}
    return sorted(states.items(), key=lambda item: names.natural(item[0]))


def _show(session: Session, found: MissionStatus) -> None:
    rows = [
        (
            platform,
            state.mission,
            state.state,
            f"{state.progress_ratio * 100:.0f} %",
            ", ".join(state.active),
            ", ".join(arrival.barrier for arrival in state.arrivals),
            _remark(state),
        )
        for platform, state in _rows(found)
    ]
    columns = [
        Column("PLATFORM"),
        Column("MISSION"),
        Column("STATE"),
        Column("PROGRESS", right=True),
        Column("BLOCKS"),
        Column("WAITS AT"),
        Column("SAYS"),
    ]
    session.out.table(columns, rows)
    reactions = [
        (one.row, one.phase, one.action, one.note or one.reason)
        for one in found.reactions
        if one.phase is not ReactionPhase.IDLE or one.note
    ]
    if reactions:
        titles = [Column("REACTION"), Column("PHASE"), Column("ACTION"), Column("REASON")]
        session.out.table(titles, reactions)
    if found.ordered_by:
        session.out.say(f"{found.platform}: ordered by {found.ordered_by}")


def _remark(state: MissionState) -> str:
    """Remark about a platform: its driver, its own text, or the operator who drained it."""
    if state.held_by:
        return f"held: driven by {state.held_by}"
    return state.text or (f"drained by {state.drained_by}" if state.drained_by else "")
