"""What tests of modules and daemons stand on: temporary nodes, processes, virtual time, leak checks.

For tests of third-party modules too; nothing here needs pytest.
"""

from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import Process, spawn
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.testing.virtual import VirtualSwarm, VirtualTime

__all__ = ["Process", "VirtualSwarm", "VirtualTime", "make_node", "no_leaks", "spawn", "tmp_node"]
