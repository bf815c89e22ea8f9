"""The processes of a node are derived from the running services, not from node.toml."""

import pytest

from swarmd.register.service import processes
from swarmware.types.register import Application, ApplicationTable

SERVICES = ("broker", "tree")


@pytest.mark.parametrize(
    ("pids", "expected"),
    [
        ({"broker": 7, "tree": 7}, "one"),
        ({"broker": 7, "tree": 8}, "per-daemon"),
        ({"broker": 7, "tree": 7, "swarmctl": 9, "camera": 10}, "one"),
        ({}, "one"),
    ],
)
def test_processes_of_node_are_those_of_its_services(pids: dict[str, int], expected: str) -> None:
    applications = tuple(Application(name, 1, pid, 0) for name, pid in pids.items())
    table = ApplicationTable("uav1", "main", 1, 1, 1, "register#1", 0, applications)
    assert processes(table, SERVICES) == expected
