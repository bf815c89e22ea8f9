"""The wheel that the machines install."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest
from tests.boot.machine import ROOT
from tests.boot.page import PAGE, blocks

RAISED: Final = "0.1.1"
"""A version above the version of the sources."""


@pytest.fixture(scope="session")
def raised_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of the same sources with a raised version."""
    folder = tmp_path_factory.mktemp("raised")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    for name in ("pyproject.toml", "lib/swarmware/__init__.py"):
        text, count = re.subn(
            r'^((?:__)?version(?:__)? = )"[^"]*"', rf'\1"{RAISED}"', (folder / name).read_text(), flags=re.M
        )
        assert count == 1, name
        (folder / name).write_text(text)
    build = [sys.executable, "-m", "hatchling", "build", "--directory", "dist", "--target", "wheel"]
    done = subprocess.run(build, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "dist" / f"swarmware-{RAISED}-py3-none-any.whl"


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the wheel, made by the first command of the page."""
    block = next(one.text for one in blocks(PAGE) if one.section == "The wheel")
    done = subprocess.run(["sh", "-ec", block], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    folder = tmp_path_factory.mktemp("dist")
    made = max((ROOT / "dist").glob("swarmware-*.whl"), key=lambda path: path.stat().st_mtime_ns)
    for file in (made, made.with_name("SHA256SUMS")):
        (folder / file.name).write_bytes(file.read_bytes())
    return folder
