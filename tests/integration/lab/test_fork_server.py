"""Nodes of a lab are forked by one server, and live, die and come back as others do."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from tests.integration.lab.conftest import Ctl
from tests.integration.lab.processes import answer, child_of, kill

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabState
from swarmctl.session.processes import NODE_MARK, ProcessIdentity


def parent_of(process: ProcessIdentity) -> int:
    return int(Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[1])


def words(path: Path) -> list[str]:
    return path.read_bytes().rstrip(b"\0").decode().split("\0")


def server_of(lab: LabState) -> ProcessIdentity:
    """The process of the lab that belongs to no node."""
    nodes = {who for found in processes.by_mark(NODE_MARK).values() for who in found}
    (server,) = set(processes.marked(lab.mark)) - nodes
    return server


def test_lab_nodes_fork_again_without_fork_server(
    ctl: Ctl, labs_folder: Path, nothing_remains: Callable[[LabState], None]
) -> None:
    ctl("lab", "up", "formation", "--nodes", "3", "--name", "forked", "--detach")
    lab = labs.find("forked")
    server, node, station = server_of(lab), lab.node("uav1"), child_of(lab.station)
    child = child_of(node)
    proc = Path(f"/proc/{child.pid}")
    assert parent_of(child) == server.pid
    assert words(proc / "cmdline")[1:4] == ["-m", "swarmd", "run"]
    assert f"NOTIFY_SOCKET={node.run_dir}/parent/notify" in words(proc / "environ")
    assert (proc / "cwd").readlink() == Path(node.folder)
    assert (proc / "fd/1").readlink() == node.log_file
    kill(child)
    assert asyncio.run(answer(lab, "uav1")).platform == "uav1"
    second = child_of(node)
    assert second != child
    assert parent_of(second) == server.pid
    kill(server, second)
    assert asyncio.run(answer(lab, "uav1")).platform == "uav1"
    assert parent_of(child_of(node)) == node.pid, "started with a new interpreter"
    assert child_of(lab.station) == station, "no other node has noticed"
    ctl("lab", "down", "forked")
    nothing_remains(lab)
