"""What `swarmctl new` makes: its own test passes as printed, and ruff, mypy and systemd accept it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from swarmctl.commands.new.scaffold import KINDS
from swarmctl.main import main as swarmctl

ROOT = Path(__file__).parents[3]
LONGEST = "{}_" + "x" * 30
STYLE = "E,F,W,I,UP,B,SIM,RET,PIE,ASYNC,BLE,PTH,RUF,T20,N,C4,PERF,PL"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder of each kind with a short name, and one with the longest."""
    folder = tmp_path_factory.mktemp("made")
    for kind in KINDS:
        assert swarmctl(["new", kind, f"{kind}_x", "--dir", str(folder)]) == 0
        assert swarmctl(["new", kind, LONGEST.format(kind)[:31], "--dir", str(folder)]) == 0
    return folder


def run(*words: str, cwd: Path) -> None:
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("kind", KINDS)
def test_the_test_of_a_scaffold_passes(kind: str, made: Path) -> None:
    words = KINDS[kind].test.replace("swarmctl", "python -m swarmctl", 1).split()
    quiet = ("-p", "no:cacheprovider") if "pytest" in words else ()
    run(sys.executable, *words[1:], *quiet, cwd=made / f"{kind}_x")


def test_the_style_of_all_scaffolds_is_clean(made: Path) -> None:
    ruff = str(Path(sys.executable).with_name("ruff"))
    common = ("--isolated", "--no-cache", "--line-length", "110", "--target-version", "py311")
    for folder in made.iterdir():
        run(ruff, "check", *common, "--select", STYLE, ".", cwd=folder)
        run(ruff, "format", "--check", "--diff", *common, ".", cwd=folder)


def test_the_types_of_all_scaffolds_are_clean(made: Path) -> None:
    config = ("--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache"))
    sources = [str(path) for folder in made.glob("*_x") for path in folder.glob("*.py")]
    run(sys.executable, "-m", "mypy", "--strict", *config, *sources, cwd=ROOT)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed here")
def test_systemd_accepts_the_unit_of_a_service(made: Path, tmp_path: Path) -> None:
    unit = tmp_path / "service_x.service"
    swarmd = Path(sys.executable).with_name("swarmd")
    source = made / "service_x/service_x.service"
    unit.write_text(source.read_text().replace("/usr/bin/swarmd", str(swarmd)))
    run("systemd-analyze", "verify", "--recursive-errors=no", str(unit), cwd=tmp_path)


def test_unit_of_service_is_hardened_like_daemons(made: Path) -> None:
    ours = (ROOT / "share/swarm/systemd" / "swarmd@.service").read_text()
    theirs = (made / "service_x/service_x.service").read_text()
    ours = ours.replace(" -/etc/swarm/keys", "")  # the broker alone writes there
    expected = ours.replace("daemon %i", "service service_x").replace("%i", "service_x")
    assert theirs.partition("[Unit]")[2] == expected.partition("[Unit]")[2]
