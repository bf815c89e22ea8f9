"""The labs of this user, and the output of their processes."""

import os
import shlex
import time
from collections import deque
from collections.abc import Sequence
from typing import Never

import msgspec

from swarmctl.session import labs
from swarmctl.session.labs import LabNode, LabState
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Detail, rows_of
from swarmware.model.config import CONFIG_VARIABLE


class LabLine(msgspec.Struct, frozen=True):
    """One lab in the list."""

    name: str
    experiment: str
    nodes: int
    alive: int
    """Number of nodes with a running process."""
    state: str
    """starting | running | partly | dead."""
    age_s: float
    ready_s: float
    multicast: str
    folder: str


class LabList(msgspec.Struct, frozen=True):
    """The labs of this user."""

    labs: list[LabLine]


class LabEnvironment(msgspec.Struct, frozen=True):
    """Variable by which a program joins a node of a lab."""

    platform: str
    config_dir: str
    """Value of SWARM_CONFIG."""


class ProcessLogLine(msgspec.Struct, frozen=True):
    """One line of a node's process log."""

    node: str
    text: str


_DETAILS: list[Detail[LabLine]] = [
    Detail("LAB", value=lambda lab: lab.name),
    Detail("EXPERIMENT", value=lambda lab: lab.experiment),
    Detail("STATE", value=lambda lab: lab.state),
    Detail("NODES", value=lambda lab: lab.nodes, right=True),
    Detail("ALIVE", value=lambda lab: lab.alive, right=True),
    Detail("AGE", value=lambda lab: spoken(lab.age_s), right=True),
    Detail("MULTICAST", value=lambda lab: lab.multicast, drop=1),
    Detail("FOLDER", value=lambda lab: lab.folder),
]


def describe(lab: LabState, now_utc_ns: int) -> LabLine:
    """The present state of one lab."""
    alive = sum(node.alive() for node in lab.nodes)
    state = "running" if alive == len(lab.nodes) else "partly" if alive else "dead"
    # a lab whose starter was killed before it was ready will not become ready
    if lab.starter.alive() and not lab.ready_s:
        state = "starting"
    return LabLine(
        lab.name,
        lab.experiment,
        len(lab.nodes),
        alive,
        state,
        (now_utc_ns - lab.created_utc_ns) / 1e9,
        lab.ready_s,
        f"{lab.multicast_group}:{lab.udp_port}",
        lab.folder,
    )


def list_labs(out: Output) -> None:
    """Print the list of labs."""
    lines = [describe(lab, time.time_ns()) for lab in labs.labs()]
    if out.settings.structured:
        out.document(LabList(lines))
        return
    empty = "no lab on this computer; `swarmctl lab up formation` starts one"
    out.table(_DETAILS, rows_of(_DETAILS, lines), empty=empty)


def print_environment(platform: str, out: Output) -> None:
    """Prints the line for a shell after which programs join a node of the lab.

    Raises: NotFound when there is no such lab or node.
    """
    node = labs.find(out.settings.lab).node(platform)
    if out.settings.structured:
        out.document(LabEnvironment(node.platform, str(node.config_dir)))
    else:
        out.verbatim(f"export {CONFIG_VARIABLE}={shlex.quote(str(node.config_dir))}")


def print_logs(lines: int, out: Output, *, follow: bool) -> None:
    """Prints the last lines of each node's log; of the selected platforms.

    With `follow` the process becomes tail(1), which prints new lines.
    Raises: NotFound when there is no such lab or node.
    """
    lab = labs.find(out.settings.lab)
    nodes = lab.select(out.settings.node)
    if follow:
        _exec_tail(nodes, lines)
    for node in nodes:
        try:
            with node.log_file.open(encoding="utf-8", errors="replace") as file:
                # keeps the last lines only, however long the log is
                last = deque(file, maxlen=lines)
        except FileNotFoundError:
            continue
        for line in last:
            if out.settings.structured:
                out.line(ProcessLogLine(node.platform, line.rstrip("\n")))
            else:
                out.text(f"{node.platform}: {line.rstrip()}" if len(nodes) > 1 else line.rstrip("\n"))


def _exec_tail(nodes: Sequence[LabNode], lines: int) -> Never:
    """Replaces the process by tail(1), which waits for new lines without polling."""
    files = [str(node.log_file) for node in nodes]
    os.execvp("tail", ["tail", "-n", str(lines), "-F", *files])
