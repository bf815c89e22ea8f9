"""Restarts services of a node by its guard, and follows them until they run again."""

import asyncio
from typing import Final

import msgspec

from swarmctl.resources.newest import newest
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.errors import Denied, NoAnswer, NotFound
from swarmware.model import names
from swarmware.types import registry
from swarmware.types.health import GuardStatus, RestartOrder, ServiceState, WatchedService
from swarmware.types.rpc import Empty
from swarmware.types.vehicle import VehicleState

GROUNDED: Final = frozenset({"health", "logger", "register"})
"""Services that flight does not depend on, so an armed vehicle may restart them."""
POLL_S: Final = 0.25
"""Polling period of the guard; an event could be missed while its broker or tree restarts."""


class RestartedServices(msgspec.Struct, frozen=True):
    """Services that were restarted and run again."""

    platform: str
    services: list[WatchedService]


async def restart(
    session: Session, wanted: tuple[str, ...], wait_s: float, *, yes: bool, force: bool
) -> None:
    """Restarts the named services, or all under the guard, one after the other, and prints each.

    Raises: NotFound for a service that is not under the guard, Denied for an armed vehicle unless `force`,
    NoAnswer when one does not run again in time; as `confirm`.
    """
    platform = session.platform
    status = await session.ask(names.join(platform, "sys/guard/status"), Empty(), GuardStatus)
    known = [one.name for one in status.services]
    if unknown := [name for name in wanted if name not in known]:
        hint = "; the guard itself is restarted by the others" if unknown[0] == "guard" else ""
        raise NotFound(
            f"service {unknown[0]!r} of {platform}: not under its guard{hint}; "
            f"expected one of {', '.join(known)}"
        )
    chosen = list(wanted) or known
    # asked before the confirmation, whose text depends on it
    armed = await is_armed(session)
    if armed and not force and not GROUNDED.issuperset(chosen):
        flies = ", ".join(name for name in chosen if name not in GROUNDED)
        raise Denied(f"{platform} is armed and flies with {flies}; expected a disarmed vehicle, or --force")
    air = ", with which the armed vehicle flies" if armed and not GROUNDED.issuperset(chosen) else ""
    await session.confirm(yes, f"restart {', '.join(chosen)}{air}: interrupted until they run again")
    if platform == session.here:
        await session.others_ended()  # they are reached through the services of this node
    # one after the other, so that a service that does not return stops the rest from being restarted
    done = [await restart_one(session, platform, name, wait_s) for name in chosen]
    if session.settings.structured:
        session.out.document(RestartedServices(platform, done))
        return
    columns = [Column("SERVICE"), Column("STATE"), Column("PID", right=True), Column("RESTARTS", right=True)]
    session.out.table(columns, [(one.name, one.state, one.pid or None, one.restarts) for one in done])


async def is_armed(session: Session) -> bool:
    """Whether the platform is a vehicle that is armed."""
    try:
        found = await newest(session, names.join(session.platform, "vehicle/state"))
    except NotFound:
        return False  # not a vehicle
    return registry.decode(VehicleState, found.data).armed


async def restart_one(session: Session, platform: str, name: str, wait_s: float) -> WatchedService:
    """Restarts one service, and returns when it runs again.

    Raises: NoAnswer when it does not run again in time, or the guard does not answer.
    """
    status = names.join(platform, "sys/guard/status")
    # the count before the order distinguishes the restart from a process that was running already
    before = _watched(await session.ask(status, Empty(), GuardStatus), name)
    await session.ask(names.join(platform, "sys/guard/restart"), RestartOrder(name), GuardStatus)
    try:
        async with asyncio.timeout(wait_s):
            while True:
                await asyncio.sleep(POLL_S)
                try:
                    now = _watched(await session.ask(status, Empty(), GuardStatus), name)
                except NoAnswer:
                    continue  # without its broker the node does not answer for a moment
                # the old process counts as running until the guard has ended it
                if now.restarts > before.restarts and now.state == ServiceState.RUNNING:
                    return now
    except TimeoutError:
        raise NoAnswer(
            f"{name} of {platform}: does not run again within {wait_s:g} s; `swarmctl health info {platform}`"
            " says more"
        ) from None


def _watched(status: GuardStatus, name: str) -> WatchedService:
    return next(one for one in status.services if one.name == name)
