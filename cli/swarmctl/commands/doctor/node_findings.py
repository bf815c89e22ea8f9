"""Findings of a running node: its faults, and the requests that it denied."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.session.session import NAME
from swarmware.errors import SwarmError
from swarmware.module.client import Client
from swarmware.types.health import Fault, FaultList, FaultQuery, Phase
from swarmware.types.net import Denial

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
    silent: str = ""
    """Why the monitor did not answer; empty: it did."""


def query_node(folder: Path) -> NodeFindings:
    """Queries the node of this configuration folder; its services must run."""
    return asyncio.run(_look(folder))


async def _look(folder: Path) -> NodeFindings:
    async with Client(NAME, config_dir=folder) as module:
        refusals = _refusals(module)
        try:
            found = await module.request("sys/health/faults", FaultQuery(), FaultList, timeout_s=ANSWER_S)
        except SwarmError as error:
            return NodeFindings((), refusals, str(error))
        confirmed = tuple(fault for fault in found.faults if fault.phase is Phase.CONFIRMED)
        return NodeFindings(confirmed, refusals)


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
