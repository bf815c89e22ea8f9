"""The unit files: what systemd itself says of them, and that they start what exists."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from swarmware.service.installed import installed as installed_services

ROOT = Path(__file__).parents[2]
UNITS = ROOT / "share/swarm/systemd"
OPERATIONS = ROOT / "share/doc/operations.md"
EXPOSURE = 2.0
"""Ceiling of `systemd-analyze security` (0 is best); 1.5 when this was written."""

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed here"
)


def allowed_calls(unit: str) -> set[str]:
    """Names of the SystemCallFilter= lines, groups not unfolded: a later line goes before an earlier one."""
    allowed: set[str] = set()
    for line in re.findall(r"^SystemCallFilter=(.*)$", unit, re.MULTILINE):
        names = set(line.removeprefix("~").split())
        allowed = allowed - names if line.startswith("~") else allowed | names
    return allowed


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """The units as they would be installed, with the swarmd of this environment."""
    swarmd = Path(sys.executable).parent / "swarmd"
    for name in ("swarmd@.service", "swarm.target", "swarm-node.service"):
        text = (UNITS / name).read_text().replace("/usr/bin/swarmd", str(swarmd))
        (tmp_path / name).write_text(text)
    instance = tmp_path / "swarmd@broker.service"
    instance.symlink_to("swarmd@.service")
    return tmp_path


@needs_systemd
@pytest.mark.parametrize("unit", ["swarmd@broker.service", "swarm.target", "swarm-node.service"])
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
@pytest.mark.parametrize("unit", ["swarmd@broker.service", "swarm-node.service"])
def test_the_hardening_stays_under_its_ceiling(installed: Path, unit: str) -> None:
    done = subprocess.run(
        [
            *("systemd-analyze", "security", "--offline=true", "--no-pager"),
            f"--threshold={EXPOSURE * 10:.0f}",
            str(installed / unit),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", done.stdout)
    assert found, done.stdout + done.stderr
    assert float(found[1]) <= EXPOSURE
    assert done.returncode == 0


def test_no_daemon_is_wanted_but_by_node_toml() -> None:
    # otherwise a flying vehicle would start a simulation without an order of its operator
    assert not re.findall(r"^(Wants|Requires)=", (UNITS / "swarm.target").read_text(), re.MULTILINE)
    assert "WantedBy=swarm.target" in (UNITS / "swarmd@.service").read_text()
    assert "swarmd units" in OPERATIONS.read_text()


def settings(unit: str) -> list[str]:
    """Lines that set something, in their order."""
    return [line for line in unit.splitlines() if re.match(r"[A-Z]\w+=", line)]


@pytest.mark.parametrize("unit", sorted(path.name for path in UNITS.glob("*.service")))
def test_no_unit_is_ever_given_up(unit: str) -> None:
    found = settings((UNITS / unit).read_text())
    assert "Restart=always" in found
    assert "StartLimitIntervalSec=0" in found
    assert not [line for line in found if line.startswith(("StartLimitBurst", "RestartPreventExitStatus"))]


def test_unit_of_whole_node_is_hardened_like_daemons() -> None:
    daemon, node = (
        settings((UNITS / name).read_text()) for name in ("swarmd@.service", "swarm-node.service")
    )
    begin = "User=swarm"
    assert daemon[daemon.index(begin) : -1] == node[node.index(begin) : -1]
    assert "KillMode=mixed" in node, "nothing of a node whose parent was killed stands in the way of the next"


def test_libzmq_may_set_the_scheduling_of_its_threads() -> None:
    """libzmq aborts the process without this system call, which a denied group may contain."""
    assert "sched_setscheduler" in allowed_calls((UNITS / "swarmd@.service").read_text())


@pytest.mark.parametrize("name", [*sorted(installed_services()), "temp-sensor", "a_b-2"])
def test_guard_may_restart_unit_of_every_service(name: str) -> None:
    rule = re.search(r"/(\^swarmd@.*\$)/\.test", (UNITS / "swarm.rules").read_text())
    assert rule
    assert re.search(rule[1], f"swarmd@{name}.service")
    assert not re.search(rule[1], f"swarmd@{name}.service.d")


def test_user_of_unit_is_created_and_owns_places() -> None:
    unit = (UNITS / "swarmd@.service").read_text()
    user = re.search(r"^User=(\w+)$", unit, re.MULTILINE)
    assert user
    assert re.search(rf"^u {user[1]} ", (UNITS / "swarm.sysusers").read_text(), re.MULTILINE)
    tmpfiles = (UNITS / "swarm.tmpfiles").read_text()
    assert re.search(rf"^d /run/swarm \d+ {user[1]} {user[1]}", tmpfiles, re.MULTILINE)
