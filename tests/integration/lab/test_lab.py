"""Labs of real processes: up, seen, down, side by side, interrupted."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tests.patience import PATIENCE_S
from tests.unit.service.folders import is_left_alone

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabState

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]
Gone = Callable[[LabState], None]


def test_ended_lab_leaves_nothing_beside_second_lab(
    ctl: Ctl, labs_folder: Path, nothing_remains: Gone
) -> None:
    up = json.loads(ctl("lab", "up", "formation", "--nodes", "3", "--detach", "--json").stdout)
    assert (up["name"], up["nodes"], up["alive"], up["state"]) == ("formation", 3, 3, "running")
    lab = labs.find()
    assert lab.ready_s > 0
    for folder in (Path(lab.folder), *(node.run_dir for node in lab.nodes)):
        assert is_left_alone(folder), "a cleaner of temporary files leaves it alone"
    (listed,) = json.loads(ctl("lab", "ls", "--json").stdout)["labs"]
    assert (listed["name"], listed["alive"]) == ("formation", 3)
    said = ctl("lab", "logs", "uav1", "--lines", "5").stdout
    assert said.strip()
    assert {line.split(":")[0] for line in ctl("lab", "logs").stdout.splitlines()} == {"gcs", "ugv1", "uav1"}

    ctl("lab", "up", "formation", "--nodes", "3", "--seed", "2", "--detach")
    first, second = labs.labs()
    assert (first.name, second.name) == ("formation", "formation2")
    assert (first.multicast_group, first.udp_port) != (second.multicast_group, second.udp_port)
    ended = json.loads(ctl("lab", "down", first.name, "--json").stdout)["ended"]
    assert ended == [{"name": "formation", "nodes": 3, "forced": 0, "left": []}]
    nothing_remains(first)
    assert second.running, "the other lab goes on"
    ctl("lab", "down", "--all")
    nothing_remains(second)
    assert list(labs_folder.iterdir()) == []


def test_taken_name_is_refused_and_dead_labs_freed(ctl: Ctl) -> None:
    ctl("lab", "up", "formation", "--nodes", "3", "--name", "mine", "--detach")
    lab = labs.find("mine")
    refused = ctl("lab", "up", "formation", "--nodes", "3", "--name", "mine", "--detach", code=1)
    assert "mine" in refused.stderr
    for node in lab.nodes:
        node.identity.send(signal.SIGKILL)
    for process in processes.marked(lab.mark):  # what a node's parent had started outlives it
        process.send(signal.SIGKILL)
    ctl("lab", "up", "formation", "--nodes", "3", "--name", "mine", "--detach")
    assert labs.find("mine").created_utc_ns > lab.created_utc_ns


def test_lab_ends_on_request(labs_folder: Path, nothing_remains: Gone) -> None:
    foreground = subprocess.Popen(
        [sys.executable, "-m", "swarmctl", "lab", "up", "formation", "--nodes", "3"],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "SWARMCTL_LABS": str(labs_folder)},
        start_new_session=True,
    )
    assert foreground.stderr is not None
    with foreground.stderr as talk:
        heard = []
        for line in talk:
            heard.append(line)
            if "Ctrl-C ends it" in line:
                break
        lab = labs.find()
        assert lab.running, heard
        foreground.send_signal(signal.SIGTERM)
        talk.read()
    assert foreground.wait(PATIENCE_S) == 130
    nothing_remains(lab)


def test_interrupt_in_middle_of_start_leaves_nothing_either(labs_folder: Path) -> None:
    foreground = subprocess.Popen(
        [sys.executable, "-m", "swarmctl", "lab", "up", "formation", "--nodes", "6", "--verbose"],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "SWARMCTL_LABS": str(labs_folder)},
        start_new_session=True,
    )
    assert foreground.stderr is not None
    with foreground.stderr as talk:
        for line in talk:
            if "started" in line:
                break
        lab = labs.labs()[0]
        foreground.send_signal(signal.SIGINT)
        talk.read()
    assert foreground.wait(PATIENCE_S) == 130
    assert list(labs_folder.iterdir()) == []
    assert not any(Path(node.shm_dir).exists() for node in lab.nodes)


def test_what_cannot_be_is_refused_before_anything_starts(ctl: Ctl, labs_folder: Path) -> None:
    assert "expected 3..200" in ctl("lab", "up", "formation", "--nodes", "2", code=7).stderr
    assert "usv1" in ctl("lab", "up", "formation", "--nodes", "3", "--per-daemon", "usv1", code=7).stderr
    assert "--net moon" in ctl("lab", "up", "formation", "--net", "moon", code=7).stderr
    assert "no such lab" in ctl("lab", "down", "nothing", code=6).stderr
    assert "lab up" in ctl("lab", "logs", code=6).stderr
    assert list(labs_folder.iterdir()) == []
