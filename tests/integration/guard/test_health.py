"""Checks of modules with a real monitor: registered, acted on, reported; complete again after a kill."""

import asyncio
import contextlib
import time
from pathlib import Path
from typing import Any

import pytest
from tests.patience import PATIENCE_S, until_answer

from swarmware.errors import InvalidInput, NoAnswer
from swarmware.health.criterion import Above
from swarmware.health.monitor import HealthMonitor
from swarmware.model.resource import Resource
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.service.service import Service
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.health import Fault, FaultList, FaultQuery, HealthReport, HealthState, Phase
from swarmware.types.rpc import Empty
from swarmware.types.scalar import Float

STILL_S = 4.0
"""Longer than three periods of the reports."""


class Motor:
    """A checked value, and the actions of the check."""

    def __init__(self) -> None:
        self.heat_degc = 20.0
        self.acted: list[tuple[str, float]] = []

    def read(self) -> float:
        return self.heat_degc

    async def cool(self, heat_degc: float) -> None:
        await asyncio.sleep(0)
        self.acted.append(("cool", heat_degc))

    def stop(self, heat_degc: float) -> None:
        self.acted.append(("stop", heat_degc))


async def fault(faults: StreamReader[Fault], check: str, phase: Phase) -> Fault:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            found = await faults.next()
            if (found.check, found.phase) == (check, phase):
                return found


async def known(module: Module, check: str) -> Any:
    """The monitor's own view of a check, as soon as it has one."""
    report = await until_answer(
        lambda: module.request("sys/health/state", Empty(), HealthReport, timeout_s=PATIENCE_S),
        lambda report: any(one.check == check for one in report.checks),
    )
    return next(one for one in report.checks if one.check == check)


def watched(module: Module, motor: Motor) -> HealthMonitor:
    monitor = HealthMonitor(module)
    monitor.register(
        "heat",
        frequency_hz=50,
        data=motor.read,
        criterion=Above(warn=80, error=95, hysteresis=5),
        actions={"warn": motor.cool, "error": motor.stop},
        confirm=(2, 3),
        clear_s=0.2,
        description="Temperature of the motor",
    )
    return monitor


async def test_registered_check_acts_and_its_fault_lives_on(
    tmp_path: Path,
) -> None:
    config = make_node(tmp_path, services={"health": {"look_hz": 10.0}})
    motor = Motor()
    with no_leaks(tmp_path / "uav1/run"):
        async with Module("motor", config_dir=config) as module:
            faults = module.stream_reader("health/faults", Fault)
            monitor = watched(module, motor)
            async with spawn(config, "health"):
                check = await known(module, "motor/heat")
                assert (check.app, check.state, check.frequency_hz) == ("motor#1", "ok", 50.0)
                motor.heat_degc = 85.0
                hot = await fault(faults, "motor/heat", Phase.CONFIRMED)
                assert (hot.state, hot.level, hot.freeze) == ("warn", "warn", "85.0")
                assert motor.acted == [("cool", 85.0)]
                motor.heat_degc = 20.0
                await fault(faults, "motor/heat", Phase.HEALED)
                await fault(faults, "motor/heat", Phase.CLEARED)
                motor.heat_degc = 99.0
                await fault(faults, "motor/heat", Phase.CONFIRMED)
                assert motor.acted[-1] == ("stop", 99.0)
                await monitor.withdraw("heat")
                await fault(faults, "motor/heat", Phase.CLEARED)


class Forwarder(Service):
    name = "forwarder"

    async def run(self) -> None:
        await asyncio.Event().wait()


async def test_stated_condition_is_fault_until_ok(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"health": {"look_hz": 10.0}})
    async with Module("forwarder", config_dir=config) as module, spawn(config, "health"):
        faults = module.stream_reader("health/faults", Fault)
        service = Forwarder(module, None)
        for detail in ("connection refused", "connection refused, 2nd try"):
            service.health.report("mongodb", "unreachable", level="warn", detail=detail, clear_s=0.2)
        away = await fault(faults, "forwarder/mongodb", Phase.CONFIRMED)
        assert (away.state, away.level, away.freeze[:10]) == ("unreachable", "warn", "connection")
        service.health.report("mongodb", "rejected")
        worse = await fault(faults, "forwarder/mongodb", Phase.CONFIRMED)
        assert (worse.state, worse.level) == ("rejected", "error")
        service.health.report("mongodb")
        await fault(faults, "forwarder/mongodb", Phase.CLEARED)
        service.health.register("heat", frequency_hz=1, data=lambda: 1.0, criterion=Above(warn=2))
        with pytest.raises(InvalidInput, match="runs it itself"):
            service.health.report("heat", "hot")


async def test_killed_monitor_restores_registrations_and_faults(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"health": {"look_hz": 10.0}})
    motor = Motor()
    async with Module("motor", config_dir=config) as module:
        faults = module.stream_reader("health/faults", Fault)
        watched(module, motor)
        async with spawn(config, "health") as health:
            await known(module, "motor/heat")
            motor.heat_degc = 99.0
            first = await fault(faults, "motor/heat", Phase.CONFIRMED)
            await health.kill()
        async with spawn(config, "health"):
            list_ = await module.request("sys/health/faults", FaultQuery(), FaultList, timeout_s=PATIENCE_S)
            (again,) = [one for one in list_.faults if one.check == "motor/heat"]
            assert (again.first_ns, again.count) == (first.first_ns, 1)
            assert (await known(module, "motor/heat")).frequency_hz == 50.0
            motor.heat_degc = 20.0
            await fault(faults, "motor/heat", Phase.HEALED)


async def test_blocked_event_loop_makes_its_checks_silent(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"health": {"look_hz": 10.0}, "timesync": {}})
    async with Module("probe", config_dir=config) as probe:
        faults = probe.stream_reader("health/faults", Fault)
        async with spawn(config, "health"):
            motor = Motor()
            watched(probe, motor)
            await known(probe, "probe/heat")
            time.sleep(STILL_S)  # noqa: ASYNC251  # the loop has to stand still: that is what is tested
            silent = await fault(faults, "probe/heat", Phase.CONFIRMED)
            assert (silent.state, silent.level) == ("silent", "warn")
            await fault(faults, "probe/heat", Phase.HEALED)


async def test_resource_of_vanished_owner_is_lost(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"health": {"look_hz": 10.0, "grace_s": 0.5}, "timesync": {}})
    async with Module("probe", config_dir=config) as probe, spawn(config, "health"):
        faults = probe.stream_reader("health/faults", Fault)
        state = probe.reader("health/state", HealthState)
        heat = probe.writer(Resource(path="motor/heat", type="Float", rate_hz=4.0, critical=True), Float)
        writing = asyncio.create_task(keep_writing(probe, heat))
        try:
            with contextlib.suppress(NoAnswer):
                while True:  # a busy computer may have faults of its own
                    assert (await faults.next(timeout_s=2.0)).check != "age/motor/heat"
        finally:
            writing.cancel()
            await asyncio.wait([writing])
        stale = await fault(faults, "age/motor/heat", Phase.CONFIRMED)
        assert (stale.state, stale.level) == ("stale", "warn")
        lost = await fault(faults, "age/motor/heat", Phase.CONFIRMED)
        assert (lost.state, lost.level) == ("lost", "error")
        async with asyncio.timeout(PATIENCE_S):
            while state.value is None or "age/motor/heat=lost" not in state.value.faults:
                await state.changed()
        assert state.value.level == "error"


async def keep_writing(module: Module, board: Any) -> None:
    async for tick in module.every(0.1):
        board.write(Float(float(tick)))
