"""Drains nodes: they take no role in a new mission, and the command waits until the running one has ended."""

import asyncio

import msgspec

from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmctl.vehicles.manoeuvre import manoeuvre
from swarmctl.vehicles.observer import VehicleObserver, raise_failures
from swarmctl.vehicles.selection import kinds
from swarmware.errors import NoAnswer
from swarmware.types.mission import INACTIVE, DrainOrder, MissionAbort, MissionState, MissionStatus
from swarmware.types.rpc import Empty

DRAIN = "sys/mission/drain"
AT_ONCE = "land"
"""Built-in mission that ends the running one with `--now`; a ground station only stops."""


class NodeDrained(msgspec.Struct, frozen=True):
    """State of a node that was drained, or of which the drain was ended."""

    platform: str
    drained_by: str
    """User that drained the node, or "" if it is not drained."""
    mission: MissionState


async def drain(session: Session, wait_s: float, *, now: bool, yes: bool) -> None:
    """Drains a node and waits until its mission has ended; `now`: ends the mission, after a confirmation.

    Raises: NoAnswer when its mission has not ended in time, the node is drained then; as `Session.confirm`
    and `raise_failures`.
    """
    status = await session.ask("sys/mission/status", Empty(), MissionStatus)
    plays = status.state.state not in INACTIVE
    await session.confirm(yes, f"drain and end {status.state.mission}: it lands" if now and plays else "")
    # asked again, because the mission may have ended or begun during the confirmation
    status = await session.ask(DRAIN, DrainOrder(True), MissionStatus)
    if status.state.state not in INACTIVE:
        session.out.say(f"{session.platform}: drained; its mission {status.state.mission} still runs")
        if now:
            kind = (await kinds(session))[session.platform]
            reason = f"drained by {status.state.drained_by}"
            ended = await manoeuvre(session, MissionAbort(reason, AT_ONCE), {session.platform: kind}, wait_s)
            raise_failures("drain", ended)
        status = await _until_ended(session, wait_s)
    _show(session, status)


async def undrain(session: Session) -> None:
    """Ends the drain of a node."""
    _show(session, await session.ask(DRAIN, DrainOrder(False), MissionStatus))


async def _until_ended(session: Session, wait_s: float) -> MissionStatus:
    """Waits for the end of the mission: a change of its board, then the answer of the node itself.

    Raises: NoAnswer when it has not ended in time.
    """
    observer = VehicleObserver(session, {})
    try:
        async with asyncio.timeout(wait_s):
            while True:
                seen = observer.snapshot(session.platform).mission
                if seen is None or seen.state in INACTIVE:  # what is received may be older than the drain
                    status = await session.ask("sys/mission/status", Empty(), MissionStatus)
                    if status.state.state in INACTIVE:
                        return status
                await observer.changed()
    except TimeoutError:
        raise NoAnswer(
            f"{session.platform}: drained, but its mission has not ended within {wait_s:g} s; --now ends it"
        ) from None


def _show(session: Session, status: MissionStatus) -> None:
    state = status.state
    if session.settings.structured:
        session.out.document(NodeDrained(session.platform, state.drained_by, state))
        return
    drained = f"drained by {state.drained_by}" if state.drained_by else "takes missions"
    mission = f"{state.mission} {state.state}".strip()
    columns = [Column("PLATFORM"), Column("STATE"), Column("MISSION")]
    session.out.table(columns, [(session.platform, drained, mission)])
