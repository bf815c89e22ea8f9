"""`swarmctl fleet upgrade`: hosts one after the other or in waves, the first failure, repetition; systemd."""

import asyncio
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.fleet.hosts import content, order, push

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.fleet import agent, running, ssh
from swarmctl.commands.fleet.agent import FleetRecord, HostAgent
from swarmctl.commands.fleet.plan import FleetGoal, HostState, HostStatus, Step
from swarmctl.commands.fleet.remote import Remote, Wheel
from swarmctl.commands.fleet.running import FleetRun
from swarmctl.installation.host import Host
from swarmctl.membership.hosts import FleetHost, HostDefaults
from swarmctl.terminal.output import Output
from swarmware.errors import Conflict, NoAnswer, Partial, SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase, MissionState
from swarmware.types.system import NodeInfo

NEW = Wheel("swarmware-2.whl", b"PK", "new")
NAMES = ("uav1", "uav2", "uav3")


class Fleet:
    """Hosts whose nodes run with the wheel `old`, and what was done on them."""

    def __init__(self, *names: str) -> None:
        self.done: list[tuple[str, str]] = []
        self.wheels = dict.fromkeys(names, "old")
        self.runs = dict.fromkeys(names, True)
        self.resume = dict.fromkeys(names, False)
        self.errors: dict[tuple[str, str], SwarmError] = {}
        """By host and step; raised once."""
        self.stopped_at_once = 0

    def remote(self, host: FleetHost, *_: object, **__: object) -> "FakeRemote":
        return FakeRemote(self, host)


class FakeRemote(Remote):
    """The steps on one host."""

    def __init__(self, fleet: Fleet, host: FleetHost) -> None:
        super().__init__(host, 1.0, 1.0)
        self.fleet = fleet

    async def _do(self, step: str) -> HostStatus:
        fleet, name = self.fleet, self.host.name
        fleet.done.append((name, step))
        await asyncio.sleep(0)
        if (error := fleet.errors.pop((name, step), None)) is not None:
            raise error
        return await self.status()

    async def status(self) -> HostStatus:
        fleet, name = self.fleet, self.host.name
        return HostStatus(
            installed=True,
            version=fleet.wheels[name],
            wheel=fleet.wheels[name],
            configured=True,
            running=fleet.runs[name],
            answers=fleet.runs[name],
            resume=fleet.resume[name],
        )

    async def upload(self, wheel: Wheel) -> None:
        await self._do("upload")

    async def stop(self, *, resume: bool) -> HostStatus:
        await self._do("stop")
        self.fleet.runs[self.host.name], self.fleet.resume[self.host.name] = False, resume
        self.fleet.stopped_at_once = max(
            self.fleet.stopped_at_once, list(self.fleet.runs.values()).count(False)
        )
        return await self.status()

    async def install(self, wheel: Wheel) -> None:
        await self._do("install")
        self.fleet.wheels[self.host.name] = wheel.sum

    async def start(self) -> HostStatus:
        await self._do("start")
        self.fleet.runs[self.host.name], self.fleet.resume[self.host.name] = True, False
        return await self.status()


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch) -> Fleet:
    found = Fleet(*NAMES)
    monkeypatch.setattr(running, "Remote", found.remote)
    return found


def upgraded(parallel: int = 1, *, stops: bool = True) -> FleetRun:
    out = Output(CliSettings(), io.StringIO(), io.StringIO())
    run = FleetRun(FleetGoal.UPGRADE, out, wheel=NEW)
    hosts = [FleetHost(name, name, HostDefaults(), Path("/")) for name in NAMES]
    asyncio.run(run.at_all(hosts, parallel, stops=stops))
    return run


def test_nodes_are_upgraded_one_after_the_other(fleet: Fleet) -> None:
    run = upgraded()
    run.check(3)
    steps = ("upload", "stop", "install", "start")
    assert fleet.done == [(name, step) for name in NAMES for step in steps]
    assert fleet.stopped_at_once == 1
    assert set(fleet.wheels.values()) == {"new"}
    assert all(
        one.steps == (Step.UPLOAD, Step.STOP, Step.INSTALL, Step.START) for one in run.outcomes.values()
    )


def test_wave_has_no_more_nodes_than_requested(fleet: Fleet) -> None:
    upgraded(2).check(3)
    assert fleet.stopped_at_once <= 2
    assert all(fleet.runs.values())


def test_first_failure_stops_upgrade_and_repeated_one_continues(fleet: Fleet) -> None:
    fleet.errors["uav2", "stop"] = Conflict("uav2: mission formation running")
    run = upgraded()
    with pytest.raises(Partial):
        run.check(3)
    assert [run.outcomes[name].state for name in NAMES] == [
        HostState.DONE,
        HostState.FAILED,
        HostState.NOT_BEGUN,
    ]
    assert "mission formation" in run.outcomes["uav2"].error
    assert all(fleet.runs.values()), "what it did not upgrade was not stopped"
    assert fleet.wheels == {"uav1": "new", "uav2": "old", "uav3": "old"}
    fleet.done.clear()
    upgraded().check(3)
    assert {name for name, _ in fleet.done} == {"uav2", "uav3"}


def test_with_keep_going_the_others_are_upgraded(fleet: Fleet) -> None:
    fleet.errors["uav1", "upload"] = NoAnswer("away")
    run = upgraded(stops=False)
    with pytest.raises(Partial):
        run.check(3)
    assert fleet.wheels == {"uav1": "old", "uav2": "new", "uav3": "new"}


def test_failed_installation_restarts_node_with_former_version(fleet: Fleet) -> None:
    fleet.errors["uav1", "install"] = SwarmError("no space left")
    run = upgraded()
    assert "the node runs again with old" in run.outcomes["uav1"].error
    assert fleet.runs["uav1"]
    assert not fleet.resume["uav1"]


def test_stopped_node_is_started_by_next_call(fleet: Fleet) -> None:
    fleet.errors["uav1", "install"] = NoAnswer("connection lost")
    upgraded()
    assert (fleet.runs["uav1"], fleet.resume["uav1"]) == (False, True)
    upgraded().check(3)
    assert all(fleet.runs.values())
    assert not fleet.resume["uav1"]


def running_node(folder: Path, monkeypatch: pytest.MonkeyPatch, mission: MissionState | None) -> None:
    """The host has a node that answers."""

    async def answers(*_: object) -> tuple[Any, Any]:
        return NodeInfo("uav1", "main", PlatformKind.UAV, "multirotor", "1", 1, 1.0, (), "", ""), False

    async def plays(*_: object) -> MissionState | None:
        return mission

    monkeypatch.setattr(HostAgent, "_answer", answers)
    monkeypatch.setattr(HostAgent, "_mission", plays)
    monkeypatch.setattr(agent, "populated", lambda _: True)
    push(folder, content(folder))


def test_node_with_mission_is_not_stopped_unless_forced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flying = MissionState(7, "00ab12cd", MissionPhase.RUNNING, mission="formation")
    calls = systemctl(tmp_path, monkeypatch)
    running_node(tmp_path, monkeypatch, flying)
    with pytest.raises(Conflict, match=r"uav1: mission formation running; expected its end"):
        HostAgent(under_systemd(tmp_path, "stop")).carry_out(b"")
    assert not calls.exists()
    HostAgent(under_systemd(tmp_path, "stop", force=True)).carry_out(b"")
    assert calls.read_text() == "stop swarm.target swarmd@*\n"


def systemctl(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A `systemctl` that records its words; the file of them."""
    calls, folder = folder / "calls", folder / "bin"
    folder.mkdir()
    program = folder / "systemctl"
    program.write_text(
        f'#!/bin/sh\necho "$@" >>{calls}\ntest "$2" != broken.service || {{ echo no >&2; exit 5; }}\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setattr(Host, "check_ready", lambda *_: None)  # it asks whether this computer runs systemd
    return calls


def under_systemd(folder: Path, verb: Any, unit: str = "swarm.target", **more: Any) -> Any:
    import msgspec

    return msgspec.structs.replace(order(folder, verb, **more), supervisor="systemd", unit=unit)


def test_under_systemd_units_are_enabled_started_and_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = systemctl(tmp_path, monkeypatch)
    running_node(tmp_path, monkeypatch, None)
    HostAgent(under_systemd(tmp_path, "stop", resume=True)).carry_out(b"")
    stored = HostAgent(under_systemd(tmp_path, "status"))._record()
    assert stored == FleetRecord(stored.files, resume=True)
    seen = HostAgent(under_systemd(tmp_path, "start")).carry_out(b"")
    assert not seen.resume
    stop, enable, start = calls.read_text().splitlines()
    assert (stop, start) == ("stop swarm.target swarmd@*", "start swarm.target")
    assert enable == "enable swarm.target"
    HostAgent(under_systemd(tmp_path, "start", "uav1.service")).carry_out(b"")
    assert calls.read_text().splitlines()[3:] == ["enable uav1.service", "start uav1.service"]
    with pytest.raises(SwarmError, match=r"broken\.service.*no"):
        HostAgent(under_systemd(tmp_path, "start", "broken.service")).carry_out(b"")


@pytest.mark.parametrize("runs", [False, True])
def test_host_of_version_without_fleet_is_absent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: bool
) -> None:
    prefix = tmp_path / "opt"
    (prefix / "bin").mkdir(parents=True)
    python = prefix / "bin/python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} -I -S "$@"\n')  # an environment without the agent
    python.chmod(0o755)
    keys = HostDefaults(prefix=str(prefix))
    host = FleetHost("uav1", "uav1", keys, tmp_path)

    async def here(_: FleetHost, words: list[str], *__: object) -> ssh.SshResult:
        done = await asyncio.to_thread(subprocess.run, words, capture_output=True, check=False)
        return ssh.SshResult(done.returncode, done.stdout, done.stderr.decode())

    monkeypatch.setattr(ssh, "run", here)
    daemon = (
        subprocess.Popen(
            [
                sys.executable,
                "-c",
                "import sys; print(flush=True); sys.stdin.read()",
                str(prefix / "bin/swarmd"),
                "node",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        if runs
        else None
    )
    try:
        if daemon is None:
            assert not asyncio.run(Remote(host, 1.0, 1.0).status()).installed
        else:
            assert daemon.stdout is not None
            daemon.stdout.readline()  # it runs, under its own words
            with pytest.raises(Conflict, match="does not know `fleet`"):
                asyncio.run(Remote(host, 1.0, 1.0).status())
    finally:
        if daemon is not None:
            daemon.communicate()
