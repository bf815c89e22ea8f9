"""The unit files: what systemd itself says of them, and that they start what exists."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UNITS = ROOT / "share/swarm/systemd"
EXPOSURE = 2.0
"""Ceiling of `systemd-analyze security` (0 is best); 1.5 when this was written."""

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed here"
)


def services() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return set(project["entry-points"]["swarmware.services"])


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """The units as they would be installed, with the swarmd of this environment."""
    swarmd = Path(sys.executable).parent / "swarmd"
    for name in ("swarmd@.service", "swarm.target"):
        text = (UNITS / name).read_text().replace("/usr/bin/swarmd", str(swarmd))
        (tmp_path / name).write_text(text)
    instance = tmp_path / "swarmd@broker.service"
    instance.symlink_to("swarmd@.service")
    return tmp_path


@needs_systemd
@pytest.mark.parametrize("unit", ["swarmd@broker.service", "swarm.target"])
def test_systemd_finds_nothing_to_say_about_the_units(installed: Path, unit: str) -> None:
    done = subprocess.run(
        ["systemd-analyze", "verify", "--recursive-errors=no", str(installed / unit)],
        capture_output=True,
        text=True,
        check=False,
    )
    # of the units of the machine it also speaks; ours are the ones in this folder
    ours = [line for line in (done.stdout + done.stderr).splitlines() if "swarm" in line]
    assert ours == []
    assert done.returncode == 0


@needs_systemd
def test_the_hardening_stays_under_its_ceiling(installed: Path) -> None:
    done = subprocess.run(
        [
            *("systemd-analyze", "security", "--offline=true", "--no-pager"),
            f"--threshold={EXPOSURE * 10:.0f}",
            str(installed / "swarmd@broker.service"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", done.stdout)
    assert found, done.stdout + done.stderr
    assert float(found[1]) <= EXPOSURE
    assert done.returncode == 0


def test_the_target_wants_every_daemon_and_nothing_else() -> None:
    text = (UNITS / "swarm.target").read_text()
    assert set(re.findall(r"swarmd@(\w+)\.service", text.split("[Unit]")[1])) == services()


def test_the_user_of_the_unit_is_made_and_owns_its_places() -> None:
    unit = (UNITS / "swarmd@.service").read_text()
    user = re.search(r"^User=(\w+)$", unit, re.MULTILINE)
    assert user
    assert re.search(rf"^u {user[1]} ", (UNITS / "swarm.sysusers").read_text(), re.MULTILINE)
    tmpfiles = (UNITS / "swarm.tmpfiles").read_text()
    assert re.search(rf"^d /run/swarm \d+ {user[1]} {user[1]}", tmpfiles, re.MULTILINE)
