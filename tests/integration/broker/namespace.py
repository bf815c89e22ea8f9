"""A program in a network namespace of its own: without foreign bytes on its loopback."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]


def figures_of(program: str, *arguments: str, tools: tuple[str, ...] = ("ip",)) -> dict[str, Any]:
    """What a program prints as JSON, by its path from this folder; skips the test without namespaces."""
    needed = ("unshare", *tools)
    if os.geteuid() != 0 or any(shutil.which(tool) is None for tool in needed):
        pytest.skip(f"needs root, {' and '.join(needed)} for a network namespace of its own")
    done = subprocess.run(
        ["unshare", "--net", sys.executable, str(Path(__file__).parent / program), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    if "unshare failed" in done.stderr:
        pytest.skip(f"no network namespace here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures
