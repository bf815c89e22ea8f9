"""The computers of platforms: which answer, what runs on each, and how far away they are."""

import asyncio
from typing import TypeVar

import msgspec

from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Detail, rows_of
from swarmware.errors import Partial, SwarmError
from swarmware.model import names
from swarmware.model.names import MAIN, Address
from swarmware.types.health import HealthReport
from swarmware.types.net import RouteState
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo

R = TypeVar("R", bound=msgspec.Struct)


class UnitOverview(msgspec.Struct, frozen=True):
    """One computer of a platform."""

    platform: str
    unit: str
    answers: bool
    info: NodeInfo | None
    health: HealthReport | None
    """Health of this computer: the applications and resources that it provides."""
    route: RouteState | None
    """Route to the computer, or null for the joined node itself."""


class UnitList(msgspec.Struct, frozen=True):
    """The computers of the selected platforms."""

    units: list[UnitOverview]


async def list_units(session: Session) -> None:
    """Prints all computers of the selected platforms, else of all.

    Raises: Partial when one did not answer.
    """
    asked = await session.selected()
    own = session.module.node.address
    found: dict[Address, RouteState | None] = {
        Address(route.platform, route.unit): route for route in (await session.routes()).routes
    }
    # no route leads to the computer itself
    found[own] = None
    chosen = sorted(
        (address for address in found if address.platform in asked or str(address) in asked),
        key=lambda one: (names.natural(one.platform), one.unit != MAIN, names.natural(one.unit)),
    )
    units = list(await asyncio.gather(*(_unit(session, one, found[one]) for one in chosen)))
    if session.settings.structured:
        session.out.document(UnitList(units))
    else:
        details: list[Detail[UnitOverview]] = [
            Detail("COMPUTER", value=lambda one: f"{one.platform}.{one.unit}"),
            Detail("STATE", value=lambda one: "answers" if one.answers else "silent"),
            Detail("UP", value=lambda one: spoken(one.info.uptime_s) if one.info else None, right=True),
            Detail("HEALTH", value=lambda one: one.health.state.level if one.health else None),
            Detail(
                "VIA", value=lambda one: one.route.via if one.route and one.route.hops > 1 else None, drop=1
            ),
            Detail(
                "SERVICES", value=lambda one: " ".join(one.info.services) if one.info else None, wraps=True
            ),
        ]
        session.out.table(details, rows_of(details, units))
    if silent := [f"{one.platform}.{one.unit}" for one in units if not one.answers]:
        raise Partial(f"computers: {', '.join(silent)} did not answer")


async def _unit(session: Session, address: Address, route: RouteState | None) -> UnitOverview:
    info, health = await asyncio.gather(
        _ask(session, address, "sys/node/info", NodeInfo),
        _ask(session, address, "sys/health/state", HealthReport),
    )
    return UnitOverview(address.platform, address.unit, info is not None, info, health, route)


async def _ask(session: Session, address: Address, path: str, reply: type[R]) -> R | None:
    """The answer of one computer, or None without one."""
    full, wait_s = names.join(address.path, path), session.settings.timeout_s
    try:
        return await session.module.request(full, Empty(), reply, timeout_s=wait_s)
    except SwarmError:
        return None
