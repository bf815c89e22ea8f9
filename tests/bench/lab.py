"""The lab that a benchmark measures, and the options of all that measure one."""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Final

from swarmctl.session import labs
from swarmctl.session.labs import LabState

NODES: Final = 16


def options(description: str | None) -> argparse.ArgumentParser:
    """A parser with `--lab` and `--json`; the description is the first line of the script's docstring."""
    parser = argparse.ArgumentParser(description=(description or "").split("\n", 1)[0])
    parser.add_argument(
        "--lab", default="", help="a running lab; default: one for the time of the measurement"
    )
    parser.add_argument("--json", action="store_true")
    return parser


@contextmanager
def _started(running: str, own: str, *how: str) -> Iterator[LabState]:
    if running:
        yield labs.find(running)
        return
    swarmctl = [sys.executable, "-m", "swarmctl", "--quiet", "lab"]
    up = ["up", "formation", *how, "--name", own, "--detach"]
    subprocess.run([*swarmctl, *up], check=True, stdout=subprocess.DEVNULL)
    try:
        yield labs.find(own)
    finally:
        subprocess.run([*swarmctl, "down", own], check=True, stdout=subprocess.DEVNULL)


def formation_lab(running: str, own: str, nodes: int = NODES) -> AbstractContextManager[LabState]:
    """The running lab of this name; without a name a lab called `own`, which ends with the block."""
    return _started(running, own, "--nodes", str(nodes))


def radio_lab(running: str, own: str, nodes: int, radio: str) -> AbstractContextManager[LabState]:
    """The same, of nodes in namespaces with that radio between them."""
    return _started(running, own, "--nodes", str(nodes), "--net", "netns", "--radio", radio)
