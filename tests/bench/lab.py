"""The lab that a benchmark measures, and the options of all that measure one."""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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
def formation_lab(running: str, own: str, nodes: int = NODES) -> Iterator[LabState]:
    """The running lab of this name; without a name a lab called `own`, which ends with the block."""
    if running:
        yield labs.find(running)
        return
    swarmctl = [sys.executable, "-m", "swarmctl", "--quiet", "lab"]
    up = ["up", "formation", "--nodes", str(nodes), "--name", own, "--detach"]
    subprocess.run([*swarmctl, *up], check=True, stdout=subprocess.DEVNULL)
    try:
        yield labs.find(own)
    finally:
        subprocess.run([*swarmctl, "down", own], check=True, stdout=subprocess.DEVNULL)
