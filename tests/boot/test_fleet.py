"""`swarmctl fleet` on three booted hosts with sshd and systemd: from bare hosts to an upgraded swarm."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from tests.boot.conftest import RAISED
from tests.boot.machine import CannotBoot, Machine, Switch, wheels, why_not

NAMES: Final = ("gcs", "uav1", "uav2")
VEHICLE: Final = '["broker", "tree", "register", "timesync", "health", "guard", "mission"]'

pytestmark = [
    pytest.mark.root,
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(bool(why_not()), reason=why_not() or "it may"),
]


class Fleet:
    """Three hosts, and the operator beside them, who has nothing but SSH."""

    def __init__(self, folder: Path, switch: Switch, wheel: Path) -> None:
        self.folder = folder
        self._switch = switch
        self._wheels = wheel
        self.hosts: dict[str, Machine] = {}
        environment = {
            key: value for key, value in os.environ.items() if not key.startswith(("SWARM", "SSH_"))
        }
        self._environment = {**environment, "NO_COLOR": "1", "SWARM_CONFIG": str(folder / "none")}

    @property
    def wheel(self) -> Path:
        return next(self._wheels.glob("swarmware-*.whl"))

    def boot(self) -> None:
        """Raises: CannotBoot."""
        subprocess.run(
            ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self.folder / "id")], check=True
        )
        known = []
        for number, (name, network) in enumerate(zip(NAMES, self._switch.ends, strict=True), 1):
            host = Machine(name, network, wheels=wheels(), dist=self._wheels, operator=self.folder)
            self.hosts[name] = host.__enter__()
            host.must("mkdir -m 700 -p .ssh; cp /mnt/operator/id.pub .ssh/authorized_keys")
            host.must("ssh-keygen -A; systemctl restart ssh")
            key = host.must("cut -d' ' -f1,2 /etc/ssh/ssh_host_ed25519_key.pub").strip()
            known.append(f"10.0.0.{number} {key}\n")
        (self.folder / "known_hosts").write_text("".join(known))
        pip = '["--no-index", "--find-links", "/mnt/wheels"]'
        text = [
            f'[defaults]\nidentity = "{self.folder}/id"\nknown_hosts = "{self.folder}/known_hosts"\n'
            f"pip = {pip}\n"
            f'\n[defaults.node]\nkind = "uav"\ntemplate = "multirotor"\nservices = {VEHICLE}\n'
        ]
        for number, name in enumerate(NAMES, 1):
            text.append(f'\n[[hosts]]\nname = "{name}"\naddress = "10.0.0.{number}"\n')
            if name == "gcs":
                text.append(f'[hosts.node]\nkind = "gcs"\ntemplate = "gcs"\nservices = {VEHICLE}\n')
        self.file.write_text("".join(text))

    @property
    def file(self) -> Path:
        return self.folder / "HOSTS.toml"

    def ctl(self, command: str, *more: str) -> "subprocess.CompletedProcess[str]":
        """`swarmctl fleet COMMAND HOSTS.toml …` in the network of the operator."""
        words = [sys.executable, "-m", "swarmctl", "fleet", command, str(self.file), *more]
        done = subprocess.run(
            ["ip", "netns", "exec", self._switch.operator, *words],
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            env=self._environment,
            timeout=300,
        )
        assert "Traceback" not in done.stderr, done.stderr
        return done

    def must(self, command: str, *more: str) -> str:
        done = self.ctl(command, *more)
        assert done.returncode == 0, f"{done.stderr}\n{done.stdout}\n{self.journal()}"
        return done.stdout

    def journal(self) -> str:
        show = "systemctl --no-pager --failed; journalctl --no-pager -u 'swarm*' -n 20"
        return "\n".join(host.run(show).stdout for host in self.hosts.values())

    def listed(self) -> dict[str, dict[str, Any]]:
        return {one["host"]: one["status"] for one in json.loads(self.must("ls", "-o", "json"))["hosts"]}

    def versions(self) -> dict[str, str]:
        return {name: status["version"] for name, status in self.listed().items()}


def steps(done: "subprocess.CompletedProcess[str]") -> list[tuple[str, str]]:
    """Host and state of each line, in their order."""
    return [(one["host"], one["state"]) for one in map(json.loads, done.stdout.splitlines())]


@pytest.fixture(scope="module")
def fleet(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    """Three bare hosts that accept the key of the operator."""
    with Switch(len(NAMES)) as switch:
        found = Fleet(tmp_path_factory.mktemp("fleet"), switch, wheel)
        try:
            found.boot()
            yield found
        except CannotBoot as error:
            pytest.skip(f"no container with systemd here: {error}")
        finally:
            for host in found.hosts.values():
                host.__exit__()


def test_three_commands_turn_bare_hosts_into_running_nodes(fleet: Fleet) -> None:
    fleet.must("push", "--wheel", str(fleet.wheel))
    fleet.must("up")
    version = re.split("-", fleet.wheel.name)[1]
    for name, status in fleet.listed().items():
        assert (status["answers"], status["version"]) == (True, version), name
        assert fleet.hosts[name].must("systemctl is-enabled swarm.target").strip() == "enabled"


def test_host_failure_ends_upgrade_and_repeat_continues_it(fleet: Fleet, raised_wheel: Path) -> None:
    former = set(fleet.versions().values())
    middle = fleet.hosts["uav1"]
    before = {name: pid(host) for name, host in fleet.hosts.items()}
    # pip of this host cannot write
    middle.must("cd /opt/swarm/bin; mount --bind -o ro . .")
    failed = fleet.ctl("upgrade", "--wheel", str(raised_wheel), "--yes", "-o", "jsonl")
    assert failed.returncode == 3, failed.stderr + failed.stdout
    found = steps(failed)
    assert found.index(("gcs", "done")) < found.index(("uav1", "connect")), "one after the other"
    assert ("uav1", "failed") in found
    assert ("uav2", "not begun") in found
    error = next(one["error"] for one in map(json.loads, failed.stdout.splitlines()) if one["error"])
    assert "runs again with" in error
    present = fleet.listed()
    assert {name: status["answers"] for name, status in present.items()} == dict.fromkeys(NAMES, True)
    assert present["gcs"]["version"] == RAISED
    assert {present[name]["version"] for name in ("uav1", "uav2")} == former
    assert pid(fleet.hosts["uav2"]) == before["uav2"], "its node was not touched"
    assert pid(fleet.hosts["gcs"]) != before["gcs"]

    middle.must("umount /opt/swarm/bin")
    upgraded = pid(fleet.hosts["gcs"])
    again = fleet.ctl("upgrade", "--wheel", str(raised_wheel), "--yes", "-o", "jsonl")
    assert again.returncode == 0, again.stderr + again.stdout
    assert [host for host, state in steps(again) if state == "stop"] == ["uav1", "uav2"]
    assert set(fleet.versions().values()) == {RAISED}
    assert pid(fleet.hosts["gcs"]) == upgraded, "a host that has the wheel is not restarted"


def test_upgrade_killed_before_start_is_finished_by_next(fleet: Fleet, wheel: Path) -> None:
    words = [sys.executable, "-m", "swarmctl", "fleet", "upgrade", str(fleet.file), "-H", "uav2", "--yes"]
    child = subprocess.Popen(
        ["ip", "netns", "exec", fleet._switch.operator, *words, "--wheel", str(fleet.wheel), "-o", "jsonl"],
        stdout=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        env=fleet._environment,
    )
    assert child.stdout is not None
    with child.stdout:
        while json.loads(child.stdout.readline())["state"] != "install":
            pass
        child.kill()
    child.wait()
    assert not fleet.listed()["uav2"]["answers"], "it was stopped for the installation"
    fleet.must("upgrade", "-H", "uav2", "--wheel", str(fleet.wheel), "--yes")
    assert fleet.listed()["uav2"]["answers"]


def test_the_whole_fleet_ends_and_starts_again(fleet: Fleet) -> None:
    fleet.must("down", "--yes")
    assert {status["running"] for status in fleet.listed().values()} == {False}
    for host in fleet.hosts.values():
        assert "active" not in host.run("systemctl is-active swarm.target").stdout.splitlines()
    fleet.must("up")
    assert {status["answers"] for status in fleet.listed().values()} == {True}
    assert set(fleet.must("exec", "--", "hostname").splitlines()) == {f"{name}: {name}" for name in NAMES}


def pid(host: Machine) -> int:
    return int(host.must("systemctl show --property=MainPID --value swarmd@tree"))
