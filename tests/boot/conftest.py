"""The wheel that the machines install."""

import subprocess
from pathlib import Path

import pytest
from tests.boot.machine import ROOT
from tests.boot.page import PAGE, blocks


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
