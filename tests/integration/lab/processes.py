"""The processes of a lab: found, killed, and their output read."""

import asyncio
import signal

from tests.patience import PATIENCE_S

from swarmctl.session import processes
from swarmctl.session.labs import LabNode, LabState
from swarmctl.session.processes import NODE_MARK, ProcessIdentity
from swarmware.errors import SwarmError
from swarmware.module.module import Module
from swarmware.types.net import Routes
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo


def child_of(node: LabNode) -> ProcessIdentity:
    """The process with the services of a one-process node."""
    (child,) = [who for who in processes.marked(node.folder, NODE_MARK) if who != node.identity]
    return child


def kill(*victims: ProcessIdentity) -> None:
    for victim in victims:
        victim.send(signal.SIGKILL)
    assert processes.wait_gone(victims, PATIENCE_S) == []


async def answer(lab: LabState, platform: str) -> NodeInfo:
    """What the node says of itself, asked from the ground station as soon as there is a way."""
    async with Module("probe", config_dir=lab.station.config_dir) as module, asyncio.timeout(PATIENCE_S):
        routes = module.reader("net/routes", Routes)
        while True:
            try:
                return await module.request(f"/{platform}/sys/node/info", Empty(), NodeInfo, timeout_s=1)
            except SwarmError:
                await routes.changed()  # written once a second, and when the way there changes
