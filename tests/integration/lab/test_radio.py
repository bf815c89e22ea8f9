"""A lab whose nodes reach each other over a radio: rights, leftovers, and a radio or node that is killed."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from tests.integration.lab.radio import at, order
from tests.integration.recorder.mongod import Mongod
from tests.patience import PATIENCE_S

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabState
from swarmctl.session.processes import NODE_MARK
from swarmware.types.net import NeighbourState

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]
Gone = Callable[[LabState], None]
Until = Callable[[str], Awaitable[NeighbourState]]


def namespaces() -> set[int]:
    """Inodes of the network namespaces of all processes."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/ns/net"):
        try:
            found.add(path.stat().st_ino)
        except OSError:
            continue  # it has ended
    return found


def radio_of(lab: LabState) -> processes.ProcessIdentity:
    (radio,) = [who for who in processes.marked(lab.mark) if b"swarmlab.radio" in words_of(who)]
    return radio


def words_of(who: processes.ProcessIdentity) -> bytes:
    return Path(f"/proc/{who.pid}/cmdline").read_bytes()


def foreground(labs_folder: Path) -> "subprocess.Popen[str]":
    words = ("up", "formation", "--nodes", "3", "--net", "netns")
    return subprocess.Popen(
        [sys.executable, "-m", "swarmctl", "lab", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "SWARMCTL_LABS": str(labs_folder)},
        start_new_session=True,
    )


def test_killed_lab_leaves_no_namespace_device_or_radio(
    rights: None, labs_folder: Path, ctl: Ctl, nothing_remains: Gone
) -> None:
    up = foreground(labs_folder)
    assert up.stderr is not None
    with up.stderr as talk:
        assert any("Ctrl-C ends it" in line for line in talk)
        lab = labs.find()
        own = {Path(node.namespace).stat().st_ino for node in lab.nodes}
        assert len(own) == 3
        assert own <= namespaces(), "the processes of each node are in its namespace"
        radio = radio_of(lab)
        up.kill()
        up.wait()
        for process in processes.marked(lab.mark):
            if process != radio:
                process.send(signal.SIGKILL)
        assert (
            processes.wait_gone([who for who in processes.marked(lab.mark) if who != radio], PATIENCE_S) == []
        )
        assert radio.alive()
    ctl("lab", "down", lab.name)
    nothing_remains(lab)
    assert not radio.alive()
    assert not own & namespaces()


def test_lab_whose_radio_ends_is_ended_with_reason(
    rights: None, labs_folder: Path, nothing_remains: Gone
) -> None:
    up = foreground(labs_folder)
    assert up.stderr is not None
    with up.stderr as talk:
        assert any("Ctrl-C ends it" in line for line in talk)
        lab = labs.find()
        radio_of(lab).send(signal.SIGKILL)
        rest = talk.read()
    assert up.wait(PATIENCE_S) == 1
    assert "radio of lab formation: ended with signal 9" in rest
    nothing_remains(lab)


def test_killed_node_returns_in_its_namespace(rights: None, labs_folder: Path) -> None:
    up = foreground(labs_folder)
    assert up.stderr is not None
    with up.stderr as talk:
        assert any("Ctrl-C ends it" in line for line in talk)
        lab = labs.find()
        for process in processes.marked(lab.node("uav1").folder, NODE_MARK):
            process.send(signal.SIGKILL)
        assert any("node uav1: ready again" in line for line in talk)

        async def seen() -> None:
            async with at(lab, "gcs") as (_, until):
                assert (await until("uav1", "up")).address.startswith("10.83.0.")

        asyncio.run(seen())
        up.send_signal(signal.SIGINT)
        talk.read()
    assert up.wait(PATIENCE_S) == 130


def start(labs_folder: Path, *before: str, mongodb: str = "") -> Done:
    """Starts a lab behind a command that takes the rights of root away."""
    return subprocess.run(
        [
            *(*before, sys.executable, "-m", "swarmctl"),
            *("lab", "up", "formation", "--nodes", "3", "--net", "netns", "--detach"),
            *(("--mongodb", mongodb) if mongodb else ()),
        ],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "SWARMCTL_LABS": str(labs_folder)},
    )


def test_a_user_without_capabilities_gets_the_same_lab(
    rights: None, labs_folder: Path, ctl: Ctl, nothing_remains: Gone
) -> None:
    # the number of the user differs there, his files are the same; a program that he starts has no capability
    done = start(labs_folder, "unshare", "--user", "--map-user=1000", "--map-group=1000")
    assert done.returncode == 0, done.stderr
    lab = labs.find()
    assert all(Path(node.user_namespace).exists() for node in lab.nodes)

    async def cut() -> None:
        async with at(lab, "gcs") as (_, until):
            assert (await until("uav1", "up")).address.startswith("10.83.0.")
            await order(ctl, "cut", "gcs", "uav1")
            await until("uav1", "down")

    asyncio.run(cut())
    ctl("lab", "down")
    nothing_remains(lab)


@pytest.mark.mongod
def test_loggers_in_namespaces_forward_to_outside_database(
    rights: None, labs_folder: Path, tmp_path: Path, ctl: Ctl, nothing_remains: Gone
) -> None:
    server = Mongod(tmp_path / "mongod")
    server.start()
    try:
        # without capabilities, as the gateway needs none
        done = start(
            labs_folder, "unshare", "--user", "--map-user=1000", "--map-group=1000", mongodb=server.uri
        )
        assert done.returncode == 0, done.stderr
        lab = labs.find()
        deadline = time.monotonic() + PATIENCE_S
        stored: set[str] = set()
        while stored != {"gcs", "ugv1", "uav1"}:
            assert time.monotonic() < deadline, f"stored of {stored}"
            found = ctl("log", "query", "/*/health/state", "--mongodb", "-", "--json", code=None)
            stored = {json.loads(line)["path"].split("/")[1] for line in found.stdout.splitlines()}
        ctl("lab", "down")
        nothing_remains(lab)
    finally:
        server.stop()


NONE = 'echo 0 > /proc/sys/user/max_user_namespaces; exec setpriv --bounding-set=-all --inh-caps=-all "$@"'
"""Shell script: no user namespaces, and no capabilities."""


def test_command_without_capabilities_and_namespaces_is_denied(rights: None, labs_folder: Path) -> None:
    done = start(labs_folder, "unshare", "--user", "--map-root-user", "sh", "-c", NONE, "sh")
    assert done.returncode == 5, done.stderr
    assert "lacks CAP_NET_ADMIN, CAP_SYS_ADMIN, and the kernel gives it no user namespace" in done.stderr
    assert labs.labs() == []
