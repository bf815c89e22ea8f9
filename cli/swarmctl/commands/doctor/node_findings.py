"""Findings of a running node: its faults, the members that it reaches, and the requests that it denied."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.session.session import NAME
from swarmware.errors import SwarmError
from swarmware.module.client import Client
from swarmware.types.health import Fault, FaultList, FaultQuery, Phase
from swarmware.types.net import Denial, RosterState, Routes
from swarmware.types.rpc import Empty

ANSWER_S: Final = 2.0
"""Time-out of the monitor, which answers within milliseconds."""
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


class NodeFindings(msgspec.Struct, frozen=True):
    """Findings at a running node."""

    faults: tuple[Fault, ...] = ()
    """Confirmed faults that are not cleared."""
    refusals: tuple[DeniedRequests, ...] = ()
    """Denied requests that are still in its shared memory; highest count first."""
    unreached: tuple[str, ...] = ()
    """Members of the swarm without a route."""
    members: int = 0
    """Other members of the swarm; 0: the node has no keys, or its broker does not answer."""
    silent: str = ""
    """Why the monitor did not answer; empty: it did."""


def query_node(folder: Path) -> NodeFindings:
    """Queries the node of this configuration folder; its services must run."""
    return asyncio.run(_look(folder))


async def _look(folder: Path) -> NodeFindings:
    async with Client(NAME, config_dir=folder) as module:
        others = await _members(module)
        found = NodeFindings(
            refusals=_refusals(module),
            unreached=tuple(name for name, reached in others.items() if not reached),
            members=len(others),
        )
        try:
            faults = await module.request("sys/health/faults", FaultQuery(), FaultList, timeout_s=ANSWER_S)
        except SwarmError as error:
            return msgspec.structs.replace(found, silent=str(error))
        confirmed = tuple(fault for fault in faults.faults if fault.phase is Phase.CONFIRMED)
        return msgspec.structs.replace(found, faults=confirmed)


async def _members(module: Client) -> dict[str, bool]:
    """The other members of the swarm, and whether each has a route; empty without a broker or keys."""
    roster = module.reader("net/roster", RosterState).value
    if roster is None or roster.revoked_self:
        return {}
    try:
        routes = await module.request("sys/broker/routes", Empty(), Routes, timeout_s=ANSWER_S)
    except SwarmError:
        return {}  # the check of services reports a broker that does not run
    reached = {route.platform for route in routes.routes}
    valid = [one.platform for one in roster.members if not one.revoked and one.platform != module.platform]
    return {name: name in reached for name in valid}


def _refusals(module: Client) -> tuple[DeniedRequests, ...]:
    found: dict[tuple[str, str, str], DeniedRequests] = {}
    for path in DENIALS:
        reader = module.stream_reader(path, Denial, from_oldest=True)
        while (denial := reader.take()) is not None:
            sender = f"{denial.caller or denial.role}@{denial.platform}"
            key = sender, denial.verb, denial.path
            before = found.get(key)
            count = denial.count + (before.count if before is not None else 0)
            age_s = (module.now_ns() - reader.meta.stamp_ns) / 1e9 if reader.meta is not None else 0.0
            found[key] = DeniedRequests(sender, denial.verb, denial.path, count, age_s, denial.reason)
    return tuple(sorted(found.values(), key=lambda one: -one.count))
