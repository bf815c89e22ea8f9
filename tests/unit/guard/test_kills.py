"""Services that are killed or fail repeatedly, in virtual time, with one restart for each end."""

from typing import Final

import pytest

from swarmd.guard.config import Config
from swarmd.guard.core.supervision import (
    Action,
    GuardCore,
    Kill,
    ReadHeartbeats,
    ReportRestart,
    Spawn,
)
from swarmware.service.exit_status import ExitStatus
from swarmware.testing.virtual import VirtualTime
from swarmware.types.health import ServiceState, SupervisorKind

NAMES: Final = ("broker", "tree", "hal", "sim", "navigator")
START_S: Final = 0.1
"""Of a process, from its start until it has its application file."""
KILLED: Final = ExitStatus(signal=9)
CRASHED: Final = ExitStatus(signal=11)
UNKNOWN: Final = ExitStatus()
"""The exit status of a process that another guard started."""
NS: Final = 1_000_000_000


class Node:
    """Services under a guard; each process joins `START_S` after its start, and beats once a second."""

    def __init__(self, supervisor: SupervisorKind = SupervisorKind.SELF) -> None:
        self.time = VirtualTime()
        self.core = GuardCore(NAMES, supervisor, Config())
        self.driver = self.time.drive(self.core, self.perform)
        self._by_systemd = supervisor is SupervisorKind.SYSTEMD
        self._pids = iter(range(10, 1_000_000))
        self._beat = 0
        self.joined: dict[str, int] = {}
        self.reported: list[str] = []
        self.away_s: list[float] = []
        """For each end, the time until the next process had joined."""
        self.fails: set[str] = set()
        """Services whose processes end before they join."""
        self._ended_ns: dict[str, int] = {}
        self.time.every(1.0, self._beats)
        self.driver.feed(self.core.on_start({}, {}, 0))
        self.time.run_for(1.0)

    def _beats(self) -> None:
        self._beat += 1

    def perform(self, action: Action) -> None:
        match action:
            case ReadHeartbeats():
                self.read()
            case Spawn(name):
                pid = next(self._pids)
                known = 0 if self._by_systemd else pid
                self.driver.feed(self.core.on_spawned(name, known, self.time.now_ns))
                self.time.after(START_S, lambda: self._start_ends(name, pid))
            case ReportRestart(service):
                self.reported.append(service.name)
            case Kill():
                raise AssertionError(action)
            case _:
                return

    def read(self) -> None:
        """Reads the table and the heartbeats, as the shell does at each change and once a second."""
        now_ns = self.time.now_ns
        actions: list[Action] = []
        for name, pid in self.joined.items():
            actions += self.core.on_joined(name, pid, now_ns)
            actions += self.core.on_heartbeat(name, self._beat, now_ns)
        self.driver.feed(actions + self.core.on_heartbeats_read(now_ns))

    def _start_ends(self, name: str, pid: int) -> None:
        if name in self.fails:
            self.driver.feed(self.core.on_exit(name, pid, CRASHED, self.time.now_ns))
            return
        self.joined[name] = pid
        if name in self._ended_ns:
            self.away_s.append((self.time.now_ns - self._ended_ns.pop(name)) / NS)
        self.read()

    def end(self, name: str, how: ExitStatus) -> None:
        """Ends the process of a service, which also changes the table."""
        pid = self.joined.pop(name)
        self._ended_ns[name] = self.time.now_ns
        self.driver.feed(self.core.on_exit(name, pid, how, self.time.now_ns))
        self.read()

    def states(self) -> set[ServiceState]:
        return {one.state for one in self.core.status().services}


@pytest.mark.parametrize("supervisor", [SupervisorKind.SELF, SupervisorKind.SYSTEMD])
@pytest.mark.parametrize("how", [KILLED, CRASHED, UNKNOWN], ids=str)
def test_thousand_spaced_kills_are_thousand_restarts(how: ExitStatus, supervisor: SupervisorKind) -> None:
    node = Node(supervisor)
    for number in range(1000):
        node.end(NAMES[number % len(NAMES)], how)
        node.time.run_for(3.0)
        assert node.states() == {ServiceState.RUNNING}
    assert len(node.reported) == node.core.status().restarts == 1000
    assert max(node.away_s) == pytest.approx(START_S)
    assert not any(one.adopted for one in node.core.status().services)


def test_service_killed_at_return_is_never_abandoned() -> None:
    node = Node()
    for _ in range(1000):
        node.end("tree", KILLED)
        node.time.run_for(START_S + 0.01)
    assert node.core.status().restarts == 1000
    assert max(node.away_s) == pytest.approx(START_S)


def test_service_failing_before_ready_is_abandoned_eventually() -> None:
    node = Node()
    node.fails.add("hal")
    node.end("hal", KILLED)
    settings = Config()
    total_s = sum(settings.back_off_s) + settings.back_off_s[-1] * settings.restart_limit
    node.time.run_for(total_s)
    hal = next(one for one in node.core.status().services if one.name == "hal")
    assert (hal.state, hal.restarts) == ("failed", settings.restart_limit)
    assert "given up after 30 restarts in a row" in hal.reason


def test_crash_after_ready_waits_unless_it_lasted() -> None:
    node = Node()
    for _ in range(4):
        node.end("hal", CRASHED)
        node.time.run_for(2.0)
    assert max(node.away_s) == pytest.approx(START_S), "each was ready for more than a second"
    node.away_s.clear()
    for _ in range(3):
        node.end("sim", CRASHED)
        while "sim" not in node.joined:
            node.time.run_for(0.01)
    assert node.away_s == pytest.approx([START_S, START_S + 0.2, START_S + 0.5])
