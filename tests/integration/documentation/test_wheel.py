"""The wheel, built from these sources: what it installs beside the code."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGES = "share/doc" + "/swarmware"
"""In an environment."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Content of the files that go to `share` of an environment, by their paths there."""
    folder = tmp_path_factory.mktemp("wheel")
    words = (sys.executable, "-m", "hatchling", "build", "--directory", str(folder), "--target", "wheel")
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return {
            name.partition(".data/data/")[2]: archive.read(name)
            for name in archive.namelist()
            if ".data/data/share/" in name
        }


@pytest.mark.parametrize("folder", ["scaffolds", "templates", "missions", "examples", "schemas", "systemd"])
def test_every_file_of_folder_is_in_wheel_unchanged(folder: str, installed: dict[str, bytes]) -> None:
    files = [path for path in (ROOT / "share/swarm" / folder).rglob("*") if path.is_file()]
    sources = [path for path in files if "__pycache__" not in path.parts]
    assert sources
    assert {str(path.relative_to(ROOT)): path.read_bytes() for path in sources} == {
        name: data for name, data in installed.items() if name.startswith(f"share/swarm/{folder}/")
    }


def test_the_tutorials_are_in_the_wheel_as_text(installed: dict[str, bytes]) -> None:
    for path in (ROOT / "share/doc/tutorials").glob("*.md"):
        assert installed[f"{PAGES}/tutorials/{path.name}"] == path.read_bytes()
