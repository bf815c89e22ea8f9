"""Findings of a running node: its faults, the members that it reaches, and the requests that it denied."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.session.session import NAME
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.model.names import Address
from swarmware.module.client import Client
from swarmware.types.health import Fault, FaultList, FaultQuery, Phase
from swarmware.types.net import Denial, LinkStatus, Neighbours, RosterState, Routes, RouteState
from swarmware.types.outage import LinkOutage, OutageTable
from swarmware.types.rpc import Empty

ANSWER_S: Final = 2.0
"""Time-out of the monitor, which answers within milliseconds."""
LINK_NS: Final = 5_000_000_000
"""Time in which a link comes up: a second, several where datagrams are lost."""
ONE_WAY: Final = (LinkStatus.RECEIVED, LinkStatus.HALF_OPEN)
DENIALS: Final = ("net/denials", "tree/denials")
"""Events of the broker and of the tree about denied requests."""


class DeniedRequests(msgspec.Struct, frozen=True):
    """Requests of one member to one address that its role does not permit, frames that it forged, or
    connections of an unknown computer."""

    sender: str
    """`role@platform`, `user@platform`, or an address."""
    verb: str
    path: str
    count: int
    age_s: float
    """Time since the last of them."""
    reason: str


class ComputerFaults(msgspec.Struct, frozen=True):
    """Findings of the monitor of one computer."""

    computer: str
    """Name of the computer, such as `uav1.fc`, or "" for the only computer of a platform."""
    faults: tuple[Fault, ...] = ()
    """Confirmed faults that are not cleared."""
    silent: str = ""
    """Why the monitor did not answer, or "" if it did."""


class NodeFindings(msgspec.Struct, frozen=True):
    """Findings at a running node."""

    computers: tuple[ComputerFaults, ...]
    """Of the own computer first, then of the others of the platform."""
    refusals: tuple[DeniedRequests, ...] = ()
    """Denied requests that are still in its shared memory; highest count first."""
    unreached: tuple[str, ...] = ()
    """Members of the swarm without a route."""
    unanswered: tuple[str, ...] = ()
    """Nodes that are received for some time, and with which no link has come up."""
    members: int = 0
    """Other members of the swarm, or 0 without keys or an answer of the broker."""
    outages: tuple[LinkOutage, ...] | None = None
    """Outages of the node's links, the newest first, or None if its broker does not answer."""


def query_node(folder: Path) -> NodeFindings:
    """Queries the node of this configuration folder; its services must run."""
    return asyncio.run(_look(folder))


async def _look(folder: Path) -> NodeFindings:
    async with Client(NAME, config_dir=folder) as module:
        refusals = _refusals(module)
        routes = await _routes(module)
        others = _members(module, routes)
        own = module.node.address
        units = sorted(route.unit for route in routes or () if route.platform == own.platform)
        computers = [own, *(Address(own.platform, unit) for unit in units)]
        return NodeFindings(
            tuple(await asyncio.gather(*(_faults(module, one, len(computers) > 1) for one in computers))),
            refusals=refusals,
            unreached=tuple(name for name, reached in others.items() if not reached),
            unanswered=_unanswered(module),
            members=len(others),
            outages=await _outages(module),
        )


async def _faults(module: Client, computer: Address, named: bool) -> ComputerFaults:
    """The confirmed faults of one computer of the platform."""
    name = computer.path if named else ""
    path = names.join(computer.path, "sys/health/faults") if named else "sys/health/faults"
    try:
        found = await module.request(path, FaultQuery(), FaultList, timeout_s=ANSWER_S)
    except SwarmError as error:
        return ComputerFaults(name, silent=str(error))
    return ComputerFaults(name, tuple(one for one in found.faults if one.phase is Phase.CONFIRMED))


async def _routes(module: Client) -> tuple[RouteState, ...] | None:
    """Routes of the node, or None without its broker, which the check of services reports."""
    try:
        return (await module.request("sys/broker/routes", Empty(), Routes, timeout_s=ANSWER_S)).routes
    except SwarmError:
        return None


def _unanswered(module: Client) -> tuple[str, ...]:
    """Nodes from which datagrams arrive, and to which there is no link."""
    table = module.reader("net/neighbours", Neighbours).value
    now_ns = module.now_ns()
    return tuple(
        one.name
        for one in ([] if table is None else table.neighbours)
        # an unnamed sender has not proved to be a member, and a new link is still coming up
        if one.state in ONE_WAY and one.platform and now_ns - one.since_ns > LINK_NS
    )


async def _outages(module: Client) -> tuple[LinkOutage, ...] | None:
    try:
        found = await module.request("sys/broker/outages", Empty(), OutageTable, timeout_s=ANSWER_S)
    except SwarmError:
        return None  # the check of services reports that the broker does not run
    return found.outages


def _members(module: Client, routes: tuple[RouteState, ...] | None) -> dict[str, bool]:
    """The other members of the swarm, and whether each has a route, or none without a broker or keys."""
    roster = module.reader("net/roster", RosterState).value
    # a revoked node reaches no member, so a list of all of them would not help
    if roster is None or roster.revoked_self or routes is None:
        return {}
    reached = {route.platform for route in routes}
    valid = [one.platform for one in roster.members if not one.revoked and one.platform != module.platform]
    return {name: name in reached for name in valid}


def _refusals(module: Client) -> tuple[DeniedRequests, ...]:
    found: dict[tuple[str, str, str], DeniedRequests] = {}
    for path in DENIALS:
        # denials from before this command count as well
        reader = module.stream_reader(path, Denial, from_oldest=True)
        while (denial := reader.take()) is not None:
            sender = f"{denial.caller or denial.role}@{denial.platform}"
            key = sender, denial.verb, denial.path
            before = found.get(key)
            count = denial.count + (before.count if before is not None else 0)
            age_s = (module.now_ns() - reader.meta.stamp_ns) / 1e9 if reader.meta is not None else 0.0
            found[key] = DeniedRequests(sender, denial.verb, denial.path, count, age_s, denial.reason)
    return tuple(sorted(found.values(), key=lambda one: -one.count))
