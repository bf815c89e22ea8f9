"""The arming gate: ready, not ready, unknown, forced, and cancelled by a later order."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S
from tests.unit.hal.bench import REST, Bench

from swarmd.hal import arming_gate
from swarmd.hal.motors import Motors
from swarmware.errors import Denied
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.chassis import ChassisReport, GainsRequest
from swarmware.types.health import NotReady, Readiness
from swarmware.types.vehicle import ArmRequest, KillRequest, MotorOrder, VehicleState

ARM = "sys/vehicle/arm"
LOW = Readiness(
    False, (NotReady("battery", "0.12"), NotReady("link", "no ground station")), ("battery", "link")
)


@asynccontextmanager
async def gated(root: Path, *services: str) -> AsyncIterator[tuple[Bench, Module, BoardWriter[Readiness]]]:
    """A chassis on the bench of a node with these services, an operator, and the monitor's board."""
    async with (
        tmp_node(root, services={name: {} for name in services or ("health",)}) as node,
        Module("hal", node=node) as module,
        Module("health", node=node) as monitor,
        Module("operator", node=node) as operator,
    ):
        chassis = Bench()
        await chassis.open(module)
        chassis.report_as(REST)
        Motors(module, chassis).serve()
        yield chassis, operator, monitor.writer("health/ready", Readiness)
        await chassis.close()


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arming_gate, "WAIT_S", 0.05)


def arm(operator: Module, *, force: bool = False, reason: str = "") -> "asyncio.Future[VehicleState]":
    """Waits for the answer to a request."""
    order = ArmRequest(True, force, reason)
    return asyncio.ensure_future(operator.request(ARM, order, VehicleState, timeout_s=PATIENCE_S))


async def waits_at_the_gate(operator: Module) -> None:
    """Returns when an earlier request has arrived, which the answer to a later request proves."""
    with pytest.raises(Denied, match="expected at least one gain"):
        await operator.request("sys/vehicle/gains", GainsRequest({}), VehicleState, timeout_s=PATIENCE_S)


async def test_ready_vehicle_arms_and_unready_refuses_with_list(tmp_path: Path, hasty: None) -> None:
    async with gated(tmp_path) as (chassis, operator, ready):
        ready.write(LOW)
        with pytest.raises(Denied, match=r"^not ready: battery: 0.12; link: no ground station$"):
            await arm(operator)
        assert chassis.orders == []
        ready.write(Readiness(True))
        assert (await arm(operator)).armed
        ready.write(LOW)
        with pytest.raises(Denied, match="not ready"):
            await arm(operator)  # armed, but on the ground: a take-off asks again
        assert chassis.report.armed
        chassis.report_as(ChassisReport(armed=True, landed=False))
        assert (await arm(operator)).armed, "one that flies is not judged"


async def test_the_arming_waits_for_the_first_readiness(tmp_path: Path) -> None:
    async with gated(tmp_path) as (chassis, operator, ready):
        waiting = arm(operator)
        await waits_at_the_gate(operator)
        ready.write(LOW)
        await waits_at_the_gate(operator)
        assert not waiting.done()
        ready.write(Readiness(True))
        assert (await waiting).armed
        assert len(chassis.orders) == 1


async def test_node_without_monitor_that_should_have_one_refuses(tmp_path: Path, hasty: None) -> None:
    async with gated(tmp_path) as (_, operator, ready):
        with pytest.raises(Denied, match="no health/ready; expected it of the service health"):
            await arm(operator)
        ready.write(Readiness(True), operator.now_ns() - 60_000_000_000)
        with pytest.raises(Denied, match="no health/ready for 60 s; expected it of the service health"):
            await arm(operator)


async def test_node_without_monitor_has_no_gate(tmp_path: Path) -> None:
    async with gated(tmp_path, "hal") as (_, operator, ready):
        ready.write(LOW)
        assert (await arm(operator)).armed


async def test_forced_arming_is_recorded_with_what_it_overrode(tmp_path: Path) -> None:
    async with gated(tmp_path) as (_, operator, ready):
        audit = operator.stream_reader("vehicle/orders", MotorOrder)
        ready.write(LOW)
        assert (await arm(operator, force=True, reason="bench test")).armed
        order = await audit.next(timeout_s=PATIENCE_S)
        assert (order.what, order.by, order.reason, order.refused, order.overridden) == (
            "arm",
            "operator#1@uav1",
            "bench test",
            "",
            "battery: 0.12; link: no ground station",
        )
        ready.write(Readiness(True))
        await arm(operator, force=True)
        assert (await audit.next(timeout_s=PATIENCE_S)).overridden == "", "there was nothing to override"


@pytest.mark.parametrize("stop", ["disarm", "kill"])
async def test_arming_that_waits_is_overtaken_by_later_order(tmp_path: Path, stop: str) -> None:
    async with gated(tmp_path) as (chassis, operator, ready):
        ready.write(LOW)
        waiting = arm(operator)
        await waits_at_the_gate(operator)
        later = (
            operator.request(ARM, ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)
            if stop == "disarm"
            else operator.request("sys/vehicle/kill", KillRequest("uav1"), VehicleState, timeout_s=PATIENCE_S)
        )
        assert not (await later).armed
        ready.write(Readiness(True))
        with pytest.raises(Denied, match="a later order replaced it"):
            await waiting
        assert not chassis.report.armed
