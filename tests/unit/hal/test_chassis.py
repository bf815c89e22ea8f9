"""The driver of a chassis: set-points, state, and orders that are answered, refused or lost."""

import asyncio
from pathlib import Path

import pytest
from tests.unit.hal.bench import bench

from swarmd.hal.driver import DeviceError
from swarmware.errors import Denied, NoAnswer
from swarmware.types.chassis import CalibrationRequest, ChassisAction
from swarmware.types.control import ControlState, Drive, DriveMode
from swarmware.types.vehicle import ArmRequest, KillRequest, MotorOrder, Setpoint, VehicleMode, VehicleState


async def test_vehicle_arms_through_chassis_with_audit(
    tmp_path: Path,
) -> None:
    async with bench(tmp_path) as (chassis, _, other):
        audit = other.stream_reader("vehicle/orders", MotorOrder)
        state = other.reader("vehicle/state", VehicleState)
        assert state.value == VehicleState(armed=False, landed=True)
        assert (await other.request("sys/vehicle/arm", ArmRequest(True), VehicleState)).armed
        assert state.value == VehicleState(armed=True, landed=True)
        chassis.refuses = "the door is open"
        with pytest.raises(Denied, match="the door is open"):
            await other.request("sys/vehicle/arm", ArmRequest(False), VehicleState)
        chassis.refuses = ""
        with pytest.raises(Denied, match="this is uav1; expected its own name"):
            await other.request("sys/vehicle/kill", KillRequest("uav2"), VehicleState)
        killed = await other.request("sys/vehicle/kill", KillRequest("uav1", "smoke"), VehicleState)
        assert not killed.armed
        entries = [await audit.next(timeout_s=20.0) for _ in range(4)]
        assert [(entry.what, bool(entry.refused), entry.reason) for entry in entries] == [
            ("arm", False, ""),
            ("disarm", True, ""),
            ("kill", True, ""),
            ("kill", False, "smoke"),
        ]


async def test_lost_orders_repeat_and_deaf_chassis_is_reported(tmp_path: Path) -> None:
    async with bench(tmp_path, answer_s=0.3) as (chassis, _, _):
        chassis.loses = 2
        assert (await chassis.execute(ChassisAction.ARM)).armed
        assert [order.number for order in chassis.orders] == [chassis.orders[0].number] * 3
        chassis.loses = 1000
        with pytest.raises(NoAnswer, match=r"chassis bench: disarm: not answered within 0.3 s"):
            await chassis.execute(ChassisAction.DISARM)
        sent = len(chassis.orders)
        await chassis.write(0)
        assert len(chassis.orders) == sent, "nobody waits for it any more"


async def test_a_kill_waits_for_no_other_order(tmp_path: Path) -> None:
    async with bench(tmp_path, answer_s=20.0) as (chassis, _, _):
        chassis.loses = 1
        arming = asyncio.create_task(chassis.execute(ChassisAction.ARM))
        await asyncio.sleep(0)
        assert not (await chassis.execute(ChassisAction.KILL)).armed
        with pytest.raises(Denied, match="a later order replaced it"):
            await arming
        assert [order.action for order in chassis.orders] == ["arm", "kill"]


async def test_no_order_overtakes_unanswered_kill(tmp_path: Path) -> None:
    async with bench(tmp_path, answer_s=20.0) as (chassis, _, _):
        await chassis.execute(ChassisAction.ARM)
        chassis.loses = 1
        kill = asyncio.create_task(chassis.execute(ChassisAction.KILL))
        await asyncio.sleep(0)
        for action in (ChassisAction.ARM, ChassisAction.GAINS):
            with pytest.raises(Denied, match=f"{action}: a kill is being executed"):
                await chassis.execute(action, {"rate_kp": 1.0})
        assert not (await kill).armed
        assert [order.action for order in chassis.orders] == ["arm", "kill", "kill"]


async def test_gains_that_another_order_overtook_are_sent_again(tmp_path: Path) -> None:
    async with bench(tmp_path, gains={"rate_kp": 0.2}) as (chassis, module, _):
        chassis.loses = 1
        await chassis.write(module.now_ns())
        await chassis.execute(ChassisAction.ARM)
        await chassis.write(module.now_ns())
        await chassis.write(module.now_ns())
        assert [order.action for order in chassis.orders] == ["gains", "arm", "gains"]
        assert chassis.orders[0].number < chassis.orders[2].number
        assert chassis.orders[2].gains == {"rate_kp": 0.2}


async def test_only_named_resting_vehicle_is_calibrated(tmp_path: Path) -> None:
    path = "sys/vehicle/calibrate"
    async with bench(tmp_path) as (chassis, _, other):
        with pytest.raises(Denied, match="this is uav1"):
            await other.request(path, CalibrationRequest("uav7"), VehicleState)
        await chassis.execute(ChassisAction.ARM)
        with pytest.raises(Denied, match="disarmed and on the ground"):
            await other.request(path, CalibrationRequest("uav1"), VehicleState)
        assert [order.action for order in chassis.orders] == ["arm"]
        await chassis.execute(ChassisAction.DISARM)
        await other.request(path, CalibrationRequest("uav1"), VehicleState)
        assert chassis.orders[-1].action is ChassisAction.CALIBRATE


async def test_set_points_are_sent_once_then_replaced(tmp_path: Path) -> None:
    async with bench(tmp_path, watchdog_s=0.5) as (chassis, module, other):
        drive = other.writer("act/drive", Drive)
        assert not await chassis.write(module.now_ns())
        assert chassis.period_s == pytest.approx(1 / 5), "at rest"
        await chassis.execute(ChassisAction.ARM)
        drive.write(Drive(1.5))
        now_ns = module.now_ns()
        assert await chassis.write(now_ns)
        assert chassis.period_s == pytest.approx(1 / 20)
        assert not await chassis.write(now_ns)
        assert chassis.failsafe(now_ns) == ""
        later_ns = now_ns + 600_000_000
        assert await chassis.write(later_ns)
        assert chassis.failsafe(later_ns) == "no set-point in act/drive for more than 0.5 s"
        assert chassis.setpoints == [Setpoint(1.5), Setpoint(0.0)]


async def test_silent_chassis_is_error_and_state_withdrawn(tmp_path: Path) -> None:
    async with bench(tmp_path) as (chassis, module, other):
        state = other.reader("vehicle/state", VehicleState)
        assert state.value is not None
        with pytest.raises(DeviceError, match="no report for more than 3 s"):
            await chassis.write(module.now_ns() + 3_100_000_000)
        await chassis.close()
        assert not state.alive
        with pytest.raises(NoAnswer, match="the device is not open"):
            await chassis.execute(ChassisAction.KILL)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (DriveMode.AUTO, VehicleMode.AUTO),
        (DriveMode.MANUAL, VehicleMode.MANUAL),
        (DriveMode.HOLD, VehicleMode.MANUAL),
        (DriveMode.PILOT, VehicleMode.MANUAL),
    ],
)
async def test_state_of_vehicle_has_mode_of_control(
    tmp_path: Path, mode: DriveMode, expected: VehicleMode
) -> None:
    async with bench(tmp_path) as (chassis, module, other):
        state = other.reader("vehicle/state", VehicleState)
        control = other.writer("control/state", ControlState)
        for written, wanted in ((mode, expected), (DriveMode.AUTO, VehicleMode.AUTO)):
            control.write(ControlState(written))
            async with asyncio.timeout(20.0):
                while state.value is None or state.value.mode is not wanted:
                    await chassis.write(module.now_ns())
                    await asyncio.sleep(0)
        control.write(ControlState(mode))
        assert (await other.request("sys/vehicle/arm", ArmRequest(True), VehicleState)).mode is expected
