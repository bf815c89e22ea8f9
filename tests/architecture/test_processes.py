"""/proc has one reader per question."""

import ast
from pathlib import Path
from typing import Final

from tests.architecture.sources import parsed, walked

ROOT: Final = Path(__file__).parents[2]
PROC: Final = {
    "lib/swarmware/runtime/pidfd.py": "field 22 of /proc/PID/stat: psutil gives wall clock times",
    "lib/swarmware/service/realtime.py": "the capabilities of this process, which psutil does not have",
    "lib/swarmware/service/fork_client.py": "the own network namespace, which psutil does not have",
    "lib/swarmware/service/status.py": "own memory, once a second, in daemons without psutil",
    "lib/swarmware/transport/shm/owner.py": "the boot id, which psutil does not have",
    "lib/swarmware/testing/leaks.py": "descriptors and children of a thread, not in psutil",
    "daemons/swarmd/hal/drivers/computer.py": "load of the computer, in each node: psutil costs a megabyte",
    "lib/swarmware/runtime/processor.py": "use of all processors, in each node: psutil costs a megabyte",
    "daemons/swarmd/guard/priorities.py": "the own capabilities, which psutil does not have",
    "daemons/swarmd/fork_server.py": "own threads and command line, before anything is imported",
    "daemons/swarmd/broker/sockets/zmq/zmq_socket.py": "the thread ids of libzmq, to set their priority",
    "cli/swarmlab/measure/host.py": "the model of the processor, which psutil does not have",
    "cli/swarmlab/radio/namespace.py": "network namespaces and own capabilities, which psutil does not have",
}
"""Readers of /proc, each with what psutil would cost or lacks."""


def sources() -> list[tuple[str, ast.Module]]:
    """Path and syntax tree of each module."""
    return [
        (str(path.relative_to(ROOT)), parsed(path))
        for folder in ("lib", "daemons", "cli")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]


def test_proc_is_read_where_psutil_does_not_serve() -> None:
    found = {
        path
        for path, tree in sources()
        for node in walked(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("/proc")
    }
    assert found == set(PROC), "expected psutil, or the reason against it in this list"
