"""Nodes of a lab that die: restarted by their supervisors, or reported with their logs."""

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from tests.integration.lab.processes import answer, child_of, kill
from tests.patience import PATIENCE_S

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabNode, LabState
from swarmctl.session.processes import NODE_MARK
from swarmlab.report.run_metadata import RunMetadata
from swarmlab.run.notify import Restarts


def kill_whole(node: LabNode) -> None:
    """All its processes, stopped before: none sees the death of another one."""
    found = processes.marked(node.folder, NODE_MARK)
    for process in found:
        process.send(signal.SIGSTOP)
    kill(*found)


def spoil(node: LabNode) -> None:
    """Spoils the configuration, so that the node cannot be started again."""
    (node.config_dir / "node.toml").write_text("platform = 7\n")


def until(lines: Iterator[str], word: str, seen: list[str]) -> None:
    """Reads on to the line with this word."""
    for line in lines:
        seen.append(line)
        if word in line:
            return
    raise AssertionError(f"no {word!r} in: {''.join(seen)}")


def command(*words: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "swarmctl", "lab", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
        start_new_session=True,
    )


def test_node_answers_after_child_or_parent_was_killed(
    labs_folder: Path, nothing_remains: Callable[[LabState], None]
) -> None:
    foreground = command("up", "formation", "--nodes", "3")
    assert foreground.stderr is not None
    with foreground.stderr as talk:
        seen: list[str] = []
        until(talk, "Ctrl-C ends it", seen)
        lab = labs.find()
        dead = child_of(lab.node("uav1"))
        kill(dead)
        until(talk, "node uav1: restarted once (signal 9)", seen)
        until(talk, "node uav1: ready again", seen)
        assert child_of(lab.node("uav1")) != dead
        assert asyncio.run(answer(lab, "uav1")).platform == "uav1"

        parent, child = lab.node("uav1").identity, child_of(lab.node("uav1"))
        kill(parent)
        until(talk, "node uav1: restarted 2 times (signal 9, parent: signal 9)", seen)
        until(talk, "node uav1: ready again", seen)
        again = labs.find().node("uav1")
        assert again.identity != parent
        assert child_of(again) == child, "the daemons went on without their parent"

        kill_whole(again)
        until(talk, "parent: signal 9, parent: signal 9)", seen)
        until(talk, "node uav1: ready again", seen)
        assert child_of(labs.find().node("uav1")) != child
        assert asyncio.run(answer(lab, "uav1")).platform == "uav1"
        foreground.send_signal(signal.SIGINT)
        talk.read()
    assert foreground.wait(PATIENCE_S) == 130
    nothing_remains(lab)


@pytest.mark.slow
def test_report_of_lab_names_dead_nodes_and_logs(
    labs_folder: Path, tmp_path: Path, nothing_remains: Callable[[LabState], None]
) -> None:
    out = tmp_path / "report"
    run = command("run", "formation", "--nodes", "3", "--out", str(out))
    assert run.stderr is not None
    with run.stderr as talk:
        seen: list[str] = []
        until(talk, "accepted by 3 platforms", seen)
        lab = labs.find()
        kill(child_of(lab.node("ugv1")))
        until(talk, "node ugv1: restarted once (signal 9)", seen)
        spoil(lab.node("uav1"))
        kill_whole(lab.node("uav1"))
        seen.append(talk.read())
    assert run.wait(PATIENCE_S) == 1, "".join(seen)
    nothing_remains(lab)

    facts = msgspec.json.decode((out / "run.json").read_bytes(), type=RunMetadata)
    nodes = {node.platform: node for node in facts.nodes}
    assert not facts.completed
    assert facts.failure == "node uav1: ended with exit code 7; logs/uav1/log.txt"
    assert [nodes[name].ended for name in ("gcs", "ugv1", "uav1")] == ["", "", "exit code 7"]
    assert nodes["ugv1"].restarts == Restarts(1, ("signal 9",))
    assert json.loads((out / "report.json").read_text())["completed"] is False
    page = (out / "report.html").read_text()
    assert nodes["uav1"].restarts == Restarts(1, ("parent: signal 9",))
    for words in (facts.failure, "node ugv1: restarted once (signal 9); logs/ugv1/log.txt"):
        assert words in "".join(seen)
        assert words in page
    for node in facts.nodes:
        assert (out / node.log).read_text().strip(), f"{node.log}: the log that is named lies there"
        assert list((out / node.log).parent.glob("*.mcap"))
