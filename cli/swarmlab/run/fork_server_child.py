"""The fork server of a lab: it imports the daemons once, and every node is a fork of it.

The nodes share the memory of their code until they write to it, and none imports anything at its start. The
lab works without it: a node is then started with a new interpreter.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmctl.session.labs import LabNode, LabState
from swarmlab.run.shared_child import SharedChild
from swarmware.service.fork_client import VARIABLE

SOCKET: Final = "fork-server"
"""File in the lab's folder."""
ROOM: Final = {"SWARM_FORK_ROOM": " " * 1024}
"""Memory in which a forked process shows its own environment: it has more variables than the server."""


class ForkServerChild(SharedChild):
    """Starts the fork server of the nodes that have one process each."""

    def __init__(self, lab: LabState, services: list[str], on_change: Callable[[], None]) -> None:
        command = [sys.executable, "-m", "swarmd", "forkserver", *services]
        socket = str(Path(lab.folder) / SOCKET)
        super().__init__(
            lab, "fork server", [*command, "--socket", socket, "--shared"], on_change, variables=ROOM
        )


def fork_variables(lab: LabState, node: LabNode) -> dict[str, str]:
    """Variables by which a node finds the fork server; none where it cannot use that.

    A node of several processes has a fork server of its own. A process cannot show what it is in /proc
    when it has entered a user namespace without starting a program.
    """
    if node.processes != "one" or node.user_namespace:
        return {}
    return {VARIABLE: str(Path(lab.folder) / SOCKET)}
