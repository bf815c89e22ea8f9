"""A lab whose nodes reach each other over a radio: links that are cut, lossy and slow; rights; leftovers."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.integration.recorder.mongod import Mongod
from tests.patience import PATIENCE_S

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabState
from swarmctl.session.processes import NODE_MARK
from swarmlab.radio.namespace import check_rights
from swarmware.errors import Denied
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.net import Neighbours, NeighbourState, Traffic
from swarmware.types.vehicle import Pose

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]
Gone = Callable[[LabState], None]
Until = Callable[[str], Awaitable[NeighbourState]]

LOST_S = 2.0
"""Maximum time until a node notes that a neighbour is lost."""
TRIES = 3
"""A busy computer is late now and then, not always."""
OBSERVED_S = 20.0
"""Time over which loss is counted: about 200 beacons."""
OBSERVED = 150
"""At least so many beacons: those of a busy computer come more slowly."""


@pytest.fixture
def rights() -> None:
    try:
        check_rights()
    except Denied as error:
        pytest.skip(str(error))


@pytest.fixture
def radio_lab(rights: None, ctl: Ctl) -> LabState:
    """Three nodes behind a radio that loses nothing itself."""
    ctl("lab", "up", "formation", "--nodes", "3", "--net", "netns", "--radio", "lan", "--detach")
    return labs.find()


@asynccontextmanager
async def at(
    lab: LabState, platform: str
) -> AsyncIterator[tuple[Module, Callable[[str, str], Awaitable[NeighbourState]]]]:
    """Joins a node; gives a wait until its neighbour has a state."""
    async with Module("probe", config_dir=lab.node(platform).config_dir) as module:
        board = module.reader("net/neighbours", Neighbours)

        async def until(neighbour: str, state: str) -> NeighbourState:
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    for one in (board.value or Neighbours()).neighbours:
                        if one.platform == neighbour and one.state == state:
                            return one
                    await board.changed()

        yield module, until


async def order(ctl: Ctl, *words: str) -> None:
    await asyncio.to_thread(ctl, "lab", *words)


async def test_a_cut_link_is_down_within_two_seconds_and_up_again_when_it_is_healed(
    radio_lab: LabState, ctl: Ctl
) -> None:
    async with at(radio_lab, "gcs") as (module, until):
        for neighbour in ("uav1", "ugv1"):
            assert (await until(neighbour, "up")).address.startswith("10.83.0.")
        for words in (("cut", "gcs", "uav1"), ("link", "uav1", "gcs", "--loss", "100")):
            seen: list[tuple[float, bool]] = []
            while not seen or seen[-1][0] >= LOST_S or not seen[-1][1]:
                assert len(seen) < TRIES, (
                    f"seconds until it is down, and whether the other link stayed: {seen}"
                )
                before_ns = module.now_ns()
                await order(ctl, *words)
                ordered_ns = module.now_ns()
                late_s = ((await until("uav1", "down")).since_ns - ordered_ns) / 1e9
                seen.append((late_s, (await until("ugv1", "up")).since_ns < before_ns))
                await order(ctl, "heal")
                await until("uav1", "up")


async def test_a_link_that_is_cut_in_one_direction_is_half_open_for_the_node_that_still_receives(
    radio_lab: LabState, ctl: Ctl
) -> None:
    async with at(radio_lab, "gcs") as (_, until):
        await until("uav1", "up")
        await order(ctl, "cut", "gcs", "uav1", "--one-way")
        await until("uav1", "half_open")


async def test_a_partition_separates_groups_and_leaves_the_links_inside_them(
    radio_lab: LabState, ctl: Ctl
) -> None:
    async with at(radio_lab, "ugv1") as (_, until):
        await until("gcs", "up")
        await order(ctl, "partition", "uav1,ugv1", "gcs")
        await until("gcs", "down")
        await until("uav1", "up")
    found = json.loads(ctl("lab", "link", "gcs", "--json").stdout)["links"]
    assert {link["state"] for link in found} == {"cut"}
    assert all(link["cut"] > 0 for link in found if link["receiver"] == "uav1")


async def counted(board: BoardReader[Traffic], neighbour: str) -> tuple[int, int]:
    """Datagrams of a neighbour that the broker received, and those that it found missing."""
    async with asyncio.timeout(PATIENCE_S):
        while True:  # a value made before the link came up does not list it
            for link in (await board.changed()).links:
                if (link.platform, link.transport) == (neighbour, "udp"):
                    return link.received_frames, link.lost


@pytest.mark.slow
async def test_the_loss_that_the_broker_counts_is_the_loss_of_the_radio_and_the_one_that_was_set(
    radio_lab: LabState, ctl: Ctl
) -> None:
    def of_radio() -> tuple[int, int]:
        (link,) = json.loads(ctl("lab", "link", "uav1", "gcs", "--one-way", "--json").stdout)["links"]
        return link["frames"], link["lost"]

    async with at(radio_lab, "gcs") as (module, until):
        await until("uav1", "up")
        module.readers("/*/nav/pose", Pose)  # poses are asked for: beacons at full rate
        traffic = module.reader("net/traffic", Traffic)
        await order(ctl, "link", "uav1", "gcs", "--loss", "30", "--one-way")
        before, radio_before = await counted(traffic, "uav1"), await asyncio.to_thread(of_radio)
        ends_ns = module.now_ns() + round(OBSERVED_S * 1e9)
        after = before
        while module.now_ns() < ends_ns or sum(after) - sum(before) < OBSERVED:
            after = await counted(traffic, "uav1")
        radio_after = await asyncio.to_thread(of_radio)
    received, lost = (b - a for a, b in zip(before, after, strict=True))
    frames, frames_lost = (b - a for a, b in zip(radio_before, radio_after, strict=True))
    # four standard deviations of so many beacons
    assert lost / (received + lost) == pytest.approx(0.3, abs=0.15)
    assert lost / (received + lost) == pytest.approx(frames_lost / (frames + frames_lost), abs=0.1)


def test_delay_and_rate_of_a_link_are_seen_by_the_nodes(radio_lab: LabState, ctl: Ctl) -> None:
    ctl("lab", "link", "uav1", "gcs", "--delay", "80ms", "--rate", "1mbit")

    async def measured() -> None:
        async with at(radio_lab, "gcs") as (module, until):
            board = module.reader("net/neighbours", Neighbours)
            async with asyncio.timeout(PATIENCE_S):
                while ((await until("uav1", "up")).rtt_ms or 0) < 160:
                    await board.changed()

    asyncio.run(measured())
    found = json.loads(ctl("lab", "link", "uav1", "gcs", "--json").stdout)["links"]
    assert all(link["impairment"]["rate_bit_s"] == 1e6 for link in found)
    assert all(link["delay_s"] >= 0.08 for link in found)


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


def test_namespaces_devices_and_the_radio_are_gone_after_a_lab_whose_process_was_killed(
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


def test_a_lab_whose_radio_ends_is_ended_with_the_reason(
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


def test_a_node_that_was_killed_is_back_in_its_namespace(rights: None, labs_folder: Path) -> None:
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
def test_loggers_in_namespaces_forward_to_a_database_outside_of_them(
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


def test_without_capabilities_and_user_namespaces_the_command_is_denied(
    rights: None, labs_folder: Path
) -> None:
    done = start(labs_folder, "unshare", "--user", "--map-root-user", "sh", "-c", NONE, "sh")
    assert done.returncode == 5, done.stderr
    assert "lacks CAP_NET_ADMIN, CAP_SYS_ADMIN, and the kernel gives it no user namespace" in done.stderr
    assert labs.labs() == []


@pytest.mark.slow
def test_the_experiment_completes_over_the_default_radio(
    rights: None, ctl: Ctl, tmp_path: Path, nothing_remains: Gone
) -> None:
    out = tmp_path / "report"
    done = ctl("lab", "run", "formation", "--nodes", "3", "--net", "netns", "--out", str(out), "--json")
    report = json.loads(done.stdout)
    assert report["completed"] is True
    run = json.loads((out / "run.json").read_text())
    assert run["net"] == "netns"
