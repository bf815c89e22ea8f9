"""Stops and starts services of a node by its guard."""

import asyncio

import msgspec

from swarmctl.resources.restart import GROUNDED, POLL_S, is_armed
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.errors import Denied, NoAnswer, NotFound
from swarmware.types.health import (
    UNSTOPPABLE,
    GuardStatus,
    ServiceState,
    StartOrder,
    StopOrder,
    WatchedService,
)
from swarmware.types.rpc import Empty


class ServicesChanged(msgspec.Struct, frozen=True):
    """Services of a platform that were stopped or started."""

    platform: str
    services: list[WatchedService]


async def stop(session: Session, wanted: tuple[str, ...], wait_s: float, *, yes: bool, force: bool) -> None:
    """Stops services and waits until they have ended; asks before.

    Raises: NotFound for a service that is not under the guard, Denied for an indispensable service and for
    an armed vehicle unless `force`, NoAnswer when one does not end in time; as `Session.confirm`.
    """
    status = await _status(session, wanted)
    for name in wanted:
        # before the confirmation, and for all names before the first is stopped
        if why := status.why_not_stopped(name):
            raise Denied(f"{session.platform}: {why}")
    armed = await is_armed(session) and not GROUNDED.issuperset(wanted)
    if armed and not force:
        flies = ", ".join(name for name in wanted if name not in GROUNDED)
        raise Denied(
            f"{session.platform} is armed and flies with {flies}; expected a disarmed vehicle, or --force"
        )
    air = ", with which the armed vehicle flies" if armed else ""
    await session.confirm(
        yes, f"stop {', '.join(wanted)}{air}: silent until `swarmctl app start` or a start of the node"
    )
    for name in wanted:
        await session.ask("sys/guard/stop", StopOrder(name), GuardStatus)
    await _until(session, wanted, ServiceState.STOPPED, wait_s)


async def start(session: Session, wanted: tuple[str, ...], wait_s: float) -> None:
    """Starts services that were stopped, and waits until they run.

    Raises: NotFound for a service that is not under the guard, NoAnswer when one does not run in time.
    """
    await _status(session, wanted)
    for name in wanted:
        await session.ask("sys/guard/start", StartOrder(name), GuardStatus)
    await _until(session, wanted, ServiceState.RUNNING, wait_s)


async def _status(session: Session, wanted: tuple[str, ...]) -> GuardStatus:
    status = await session.ask("sys/guard/status", Empty(), GuardStatus)
    known = [one.name for one in status.services]
    # the unstoppable ones are refused later with their own reason
    if unknown := [name for name in wanted if name not in known and name not in UNSTOPPABLE]:
        raise NotFound(
            f"service {unknown[0]!r} of {session.platform}: not under its guard;"
            f" expected one of {', '.join(known)}"
        )
    return status


async def _until(session: Session, wanted: tuple[str, ...], state: ServiceState, wait_s: float) -> None:
    """Prints the services when all have this state.

    Raises: NoAnswer when one has not in time.
    """
    end_ns = session.module.now_ns() + round(wait_s * 1e9)
    while True:
        status = await session.ask("sys/guard/status", Empty(), GuardStatus)
        found = [one for one in status.services if one.name in wanted]
        late = [one for one in found if one.state != state]
        if not late:
            break
        if session.module.now_ns() >= end_ns:
            named = ", ".join(f"{one.name} ({one.state})" for one in late)
            raise NoAnswer(f"{named} of {session.platform}: not {state} within {wait_s:g} s")
        await asyncio.sleep(POLL_S)
    if session.settings.structured:
        session.out.document(ServicesChanged(session.platform, found))
        return
    columns = [Column("SERVICE"), Column("STATE"), Column("PID", right=True)]
    session.out.table(columns, [(one.name, state_text(one), one.pid or None) for one in found])


def state_text(one: WatchedService) -> str:
    """State of a service as a table shows it."""
    return f"{one.state} by {one.stopped_by}" if one.stopped_by else str(one.state)
