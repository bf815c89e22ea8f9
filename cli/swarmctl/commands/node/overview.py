"""All nodes in one table, with their reports and their newest states received here."""

import asyncio

import msgspec

from swarmctl.commandline.nodes import names_one
from swarmctl.commands.node.sync import NodeSync, synchronisation
from swarmctl.resources.fanout import ask_all, read_boards, warn_errors
from swarmctl.resources.last_values import last_values
from swarmctl.resources.platform_health import platform_health
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Cell, Detail, rows_of
from swarmware.errors import Partial, SwarmError
from swarmware.model import names
from swarmware.types.control import ControlState
from swarmware.types.health import HealthState
from swarmware.types.mission import MissionState
from swarmware.types.net import RouteState
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo
from swarmware.types.vehicle import BatteryState, Pose, VehicleState


class NodeOverview(msgspec.Struct, frozen=True):
    """One row of the overview: a platform and what is known of it."""

    platform: str
    answers: bool
    info: NodeInfo | None
    route: RouteState | None
    health: HealthState | None
    mission: MissionState | None
    mode: str | None
    """Mode of a vehicle: auto | manual | hold | pilot."""
    armed: bool | None
    height_m: float | None
    """Estimated height of the vehicle above the map's origin."""
    battery_ratio: float | None
    lost_s: float | None
    """Time since the newest sign of a platform without a route; its other values are the last known ones."""
    sync: NodeSync | None = None
    """Whether its data are synchronised, or null if its tree did not answer."""
    units: tuple[str, ...] = ()
    """The platform's computers that have a route; of the joined platform without this computer."""


class NodeList(msgspec.Struct, frozen=True):
    """The nodes of the swarm."""

    nodes: list[NodeOverview]


async def overview(session: Session) -> tuple[list[NodeOverview], dict[str, SwarmError]]:
    """The selected platforms, else all known ones; and the errors of those without an answer."""
    asked = await session.selected()
    ways, units = _ways((await session.routes()).routes)
    (
        ((infos, errors), (healths, _), (missions, _), (vehicles, _), (poses, _), (batteries, _)),
        (controls, _),
        syncs,
    ) = await asyncio.gather(
        asyncio.gather(
            ask_all(session, asked, "sys/node/info", Empty(), NodeInfo),
            platform_health(session, asked),
            read_boards(session, asked, "mission/state", MissionState),
            read_boards(session, asked, "vehicle/state", VehicleState),
            read_boards(session, asked, "nav/pose", Pose),
            read_boards(session, asked, "power/battery", BatteryState),
        ),
        # boards without a subscriber here have no mirror, so their owners are asked
        read_boards(session, asked, "control/state", ControlState, fresh=True),
        synchronisation(session, asked),
    )
    away = [name for name in asked if name != session.here and name not in ways]
    lost = {
        last.platform: last for last in await asyncio.gather(*(last_values(session, name) for name in away))
    }
    nodes = []
    for name in asked:
        vehicle, pose, battery = vehicles.get(name), poses.get(name), batteries.get(name)
        control = controls.get(name)
        last = lost.get(name)
        # `read_boards` does not read a platform without a route, so its last values are taken
        if last is not None:
            vehicle, pose, battery = last.vehicle, last.pose, last.battery
        nodes.append(
            NodeOverview(
                name,
                name in infos,
                infos.get(name),
                ways.get(name),
                healths.get(name),
                last.mission if last else missions.get(name),
                control.mode if control and last is None else vehicle.mode if vehicle else None,
                vehicle.armed if vehicle else None,
                round(pose.z_m, 2) if pose else None,
                round(battery.remaining_ratio, 3) if battery else None,
                last.seen_s if last else None,
                syncs.get(name),
                units.get(name, ()),
            )
        )
    return nodes, errors


def _ways(routes: tuple[RouteState, ...]) -> tuple[dict[str, RouteState], dict[str, tuple[str, ...]]]:
    """The shortest route to each platform, and the names of its computers, `main` first."""
    ways: dict[str, RouteState] = {}
    units: dict[str, tuple[str, ...]] = {}
    # sorted so that `main` wins among routes of equal length
    for route in sorted(routes, key=lambda one: (one.unit != names.MAIN, one.unit)):
        units[route.platform] = (*units.get(route.platform, ()), route.unit)
        known = ways.get(route.platform)
        if known is None or route.hops < known.hops:
            ways[route.platform] = route
    return ways, units


def table(
    session: Session, nodes: list[NodeOverview]
) -> tuple[list[Detail[NodeOverview]], list[tuple[Cell, ...]]]:
    """Columns and rows of the table."""
    details: list[Detail[NodeOverview]] = [
        Detail("NODE", value=lambda one: one.platform),
        Detail("STATE", value=_presence),
        Detail("UP", value=lambda one: spoken(one.info.uptime_s) if one.info else None, right=True),
        Detail("HEALTH", value=lambda one: one.health.level if one.health else None),
        Detail("SYNC", value=lambda one: str(one.sync) if one.sync else None, drop=1),
        Detail("MODE", value=lambda one: one.mode),
        Detail("ARMED", value=lambda one: one.armed),
        Detail(
            "HEIGHT m",
            value=lambda one: None if one.height_m is None else f"{round(one.height_m, 1) + 0.0:.1f}",
            right=True,
        ),
        Detail(
            "BATTERY",
            value=lambda one: None if one.battery_ratio is None else f"{one.battery_ratio:.0%}",
            right=True,
        ),
        Detail("MISSION", value=lambda one: _mission_text(one.mission) if one.mission else None),
        Detail("VIA", value=lambda one: one.route.via if one.route and one.route.hops > 1 else None, drop=2),
        Detail(
            "HOPS",
            value=lambda one: one.route.hops if one.route else 0 if one.platform == session.here else None,
            right=True,
            drop=3,
        ),
        Detail("UNITS", value=lambda one: " ".join(one.units) or None, wide=True),
    ]
    return details, rows_of(details, nodes)


def _mission_text(state: MissionState) -> str:
    """formation running | formation done, drained by operator@gcs."""
    drained = f"drained by {state.drained_by}" if state.drained_by else ""
    return ", ".join(filter(None, (f"{state.mission} {state.state}".strip(), drained)))


def _presence(node: NodeOverview) -> str:
    """answers | silent | lost 12s ago | away."""
    if node.answers:
        return "answers"
    if node.route:
        return "silent"
    return "away" if node.lost_s is None else f"lost {spoken(node.lost_s)} ago"


async def list_nodes(session: Session) -> None:
    """Prints all nodes.

    Raises: Partial when one did not answer; the error itself when `-n` names it.
    """
    nodes, errors = await overview(session)
    # a single named node fails with its own error and exit code, not as a part of a list
    if session.platform in errors and names_one(session.settings.node):
        raise errors[session.platform]
    if session.settings.structured:
        session.out.document(NodeList(nodes))
    else:
        session.out.table(*table(session, nodes))
    warn_errors(session, errors)
    if errors:
        raise Partial(f"nodes: {len(errors)} of {len(nodes)} did not answer")
