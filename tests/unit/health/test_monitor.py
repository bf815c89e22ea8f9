"""The checks of a module: sampled, acted on, reported, and registered with the monitor that runs."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from swarmware.errors import InvalidInput, SwarmError
from swarmware.health.criterion import Above
from swarmware.health.monitor import ADDRESS, FAILED_STATE, HealthMonitor, ReportedCondition
from swarmware.model import paths
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types.health import CheckRegistration, CheckReport, CheckReports, StateRule

PATIENCE_S = 20.0


class Motor:
    """A temperature, and the actions of its check."""

    def __init__(self) -> None:
        self.heat_degc = 20.0
        self.broken = False
        self.acted: list[tuple[str, float]] = []

    async def read(self) -> float:
        if self.broken:
            raise SwarmError("no sensor")
        return self.heat_degc

    def cool(self, heat_degc: float) -> None:
        self.acted.append(("cool", heat_degc))

    async def stop(self, heat_degc: float) -> None:
        self.acted.append(("stop", heat_degc))


def watched(module: Module, motor: Motor, **others: Any) -> HealthMonitor:
    monitor = HealthMonitor(module)
    actions = {"warn": motor.cool, "error": motor.stop}
    limits = Above(warn=80, error=95)
    monitor.register("heat", frequency_hz=200, data=motor.read, criterion=limits, actions=actions, **others)
    return monitor


async def reported(board: BoardReader[CheckReports], state: str) -> CheckReport:
    """The report of the only check, as soon as its state is this one."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            value = board.value
            if value is not None and value.reports and value.reports[0].state == state:
                return value.reports[0]
            await board.changed()


async def test_check_is_registered_at_each_start_of_monitor(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        watched(module, Motor(), levels={"error": "warn"}, confirm=(2, 3), clear_s=0.5)
        await reported(module.reader(paths.checks("motor", 1), CheckReports), "ok")
        for _ in range(2):
            async with Module("health", node=node) as monitor:
                box = monitor.inbox(ADDRESS, CheckRegistration)
                found = await box.next(PATIENCE_S)
                assert (found.check, found.app, found.frequency_hz) == ("motor/heat", "motor#1", 200.0)
                assert (found.confirm_n, found.confirm_m, found.clear_s) == (2, 3, 0.5)
                assert found.states == (
                    StateRule("error", "warn", ("error",)),
                    StateRule("warn", "warn", ("warn",)),
                )
                assert await module.send(ADDRESS, found)  # so the answer to the first one has arrived, too


async def test_check_is_registered_again_with_new_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmware.node.node.TEND_NS", 10_000_000)
    monkeypatch.setattr("swarmware.node.node.TEND_PHASE_NS", 0)
    monkeypatch.setattr("swarmware.health.monitor.REPORT_S", 0.01)
    async with (
        tmp_node(tmp_path) as node,
        Module("motor", node=node) as module,
        Module("health", node=node) as monitor,
    ):
        box = monitor.inbox(ADDRESS, CheckRegistration)
        watched(module, Motor())
        for _ in range(2):
            assert (await box.next(PATIENCE_S)).check == "motor/heat"
            # for the monitor an application without a file has left, and takes its checks with it
            (paths.applications(node.run_dir) / paths.application_file("motor", 1)).unlink()
        assert (await box.next(PATIENCE_S)).check == "motor/heat"


async def test_a_registration_that_is_not_accepted_is_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with (
        tmp_node(tmp_path) as node,
        Module("motor", node=node) as module,
        Module("health", node=node) as monitor,
    ):
        box = monitor.inbox(ADDRESS, CheckRegistration)
        refusals = [Outcome(Status.EXPIRED), Outcome(Status.REFUSED)]
        accepted = module.send

        async def send(address: str, value: CheckRegistration) -> Outcome:
            return refusals.pop() if refusals else await accepted(address, value)

        monkeypatch.setattr(module, "send", send)
        watched(module, Motor())
        assert (await box.next(PATIENCE_S)).check == "motor/heat"
        assert refusals == []


async def test_confirmed_state_runs_its_action_and_is_reported(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        motor = Motor()
        watched(module, motor)
        board = module.reader(paths.checks("motor", 1), CheckReports)
        assert (await reported(board, "ok")).check == "motor/heat"
        motor.heat_degc = 85.0
        assert (await reported(board, "warn")).freeze == "85.0"
        motor.heat_degc = 99.0
        assert (await reported(board, "error")).freeze == "99.0"
        assert motor.acted == [("cool", 85.0), ("stop", 99.0)]


async def test_unreadable_data_is_state_without_action(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        motor = Motor()
        watched(module, motor)
        motor.broken = True
        report = await reported(module.reader(paths.checks("motor", 1), CheckReports), FAILED_STATE)
        assert report.freeze == "no sensor"
        assert motor.acted == []


async def test_withdrawn_check_is_unreported_and_monitor_informed(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        monitor = watched(module, Motor())
        board = module.reader(paths.checks("motor", 1), CheckReports)
        await reported(board, "ok")
        async with Module("health", node=node) as health:
            box = health.inbox(ADDRESS, CheckRegistration)
            assert not (await box.next(PATIENCE_S)).withdrawn
            await monitor.withdraw("heat")
            last = await box.next(PATIENCE_S)
        assert (last.check, last.withdrawn) == ("motor/heat", True)
        assert board.value is not None and board.value.reports == ()
        monitor.register(
            "heat", frequency_hz=1, data=lambda: 1.0, criterion=Above(warn=2)
        )  # its name is free


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"frequency_hz": 0.0}, "expected more than 0"),
        ({"frequency_hz": float("nan")}, "expected more than 0"),
        ({"frequency_hz": 1.0, "confirm": (3, 2)}, "check 'heat': "),
    ],
)
async def test_numbers_that_are_out_of_range_are_refused(
    tmp_path: Path, numbers: dict[str, Any], words: str
) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        with pytest.raises(InvalidInput, match=words):
            HealthMonitor(module).register("heat", data=lambda: 1.0, criterion=Above(warn=2), **numbers)


async def test_a_name_has_one_check(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        monitor = watched(module, Motor())
        with pytest.raises(InvalidInput, match="'heat': registered already by motor#1"):
            monitor.register("heat", frequency_hz=1, data=lambda: 1.0, criterion=Above(warn=2))
        with pytest.raises(InvalidInput, match="'heat': motor#1 runs it itself"):
            monitor.report("heat", "hot")


async def test_stated_condition_has_level_of_its_state(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("motor", node=node) as module:
        monitor = HealthMonitor(module)
        monitor.report("oil", description="Oil pressure")
        board = module.reader(paths.checks("motor", 1), CheckReports)
        await reported(board, "ok")
        monitor.report("oil", "low", level="warn", detail="x" * 500)
        low = await reported(board, "low")
        assert (low.check, low.level, len(low.freeze)) == ("motor/oil", "warn", 200)
        monitor.report("oil", "none")
        assert (await reported(board, "none")).level == "error"


def test_new_detail_alone_is_no_change_of_condition() -> None:
    condition = ReportedCondition(CheckRegistration("motor/oil", "motor#1", 1.0), 5)
    assert condition.set("low", "warn", "1 bar", 6)
    assert not condition.set("low", "warn", "0.9 bar", 7)
    report = condition.report()
    assert (report.state, report.level, report.freeze, report.stamp_ns) == ("low", "warn", "0.9 bar", 7)
    assert condition.set("low", "error", "0.9 bar", 8)
