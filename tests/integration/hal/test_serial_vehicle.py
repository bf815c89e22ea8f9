"""A vehicle with the drivers of a real vehicle: its devices are simulated behind serial lines."""

import asyncio
import math
from contextlib import suppress
from pathlib import Path

import pytest
from tests.integration.hal.nodes import DRIVERS, pulsed_node
from tests.patience import PATIENCE_S, until_value

from swarmd.hal.config import Config as HalConfig
from swarmd.hal.config import (
    CrsfDriver,
    NmeaDriver,
    RecognitionRule,
    SerialChassisDriver,
    SonarDriver,
    VectorNavDriver,
)
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import SerialConfig
from swarmware.devices.nmea import fix_sentences
from swarmware.errors import Denied, NoAnswer
from swarmware.module.module import Module
from swarmware.runtime.pseudo_terminal import PseudoTerminal
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.control import ControlState, DriveMode, SafetySwitch, SwitchRequest
from swarmware.types.driver import DriverTable
from swarmware.types.navigation import Goal, GoalKind, NavStatus
from swarmware.types.scalar import Float
from swarmware.types.tree import TreeEntry, TreeList, TreeListing
from swarmware.types.vehicle import ArmRequest, BatteryState, GnssFix, Pose, VehicleMode, VehicleState

ARM = "sys/vehicle/arm"


def serial_node(root: Path) -> Path:
    """A node whose hardware abstraction has no driver of the simulation."""
    lines = root / "dev"
    hal = HalConfig(
        drivers=DRIVERS,
        retry_s=0.2,
        nmea=NmeaDriver(device=str(lines / "gnss"), baud=38400),
        vectornav=VectorNavDriver(device=str(lines / "imu"), rate_hz=20.0),
        sonar=SonarDriver(device=str(lines / "sonar"), rate_hz=20.0, max_m=6.4),
        crsf=CrsfDriver(device=str(lines / "rc")),
        serial_chassis=SerialChassisDriver(device=str(lines / "chassis")),
    )
    return make_node(root, services={"sim": SimConfig(serial=SerialConfig(folder=str(lines))), "hal": hal})


def test_vehicle_of_serial_devices_arms_flies_and_lands(tmp_path: Path) -> None:
    async def fly() -> None:
        config_dir = serial_node(tmp_path)
        async with (
            spawn(config_dir, "sim", "hal", "control", "navigator"),
            Module("test", config_dir=config_dir) as m,
        ):
            goals, status = m.writer("nav/goal", Goal), m.reader("nav/status", NavStatus)
            truth, pose = m.reader("sim/truth", Pose), m.reader("nav/pose", Pose)
            vehicle = m.reader("vehicle/state", VehicleState)
            drivers = m.reader("hal/drivers", DriverTable)
            await until_value(drivers, lambda table: all(one.state == "running" for one in table.drivers))
            assert drivers.value is not None
            assert [one.name for one in drivers.value.drivers] == list(DRIVERS)
            await until_value(vehicle, lambda state: state == VehicleState(False, True))
            await until_value(
                m.reader("power/battery", BatteryState), lambda battery: battery.voltage_v > 20.0
            )
            start = await until_value(pose, lambda _: True)

            assert (await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)).armed
            goals.write(Goal(1, GoalKind.TAKEOFF, z_m=3.0, speed_m_s=1.5))
            await until_value(status, lambda s: s.goal_seq == 1 and s.state == "arrived")
            assert (
                await until_value(m.reader("sensor/height", Float), lambda _: True)
            ).value == pytest.approx(3.0, abs=0.5)
            with pytest.raises(Denied, match="in the air"):
                await m.request(ARM, ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)
            goals.write(Goal(2, GoalKind.GOTO, start.x_m + 4.0, start.y_m + 3.0, 3.0, speed_m_s=2.0))
            await until_value(status, lambda s: s.goal_seq == 2 and s.state == "arrived")
            here = truth.value
            assert here is not None
            assert math.dist((here.x_m, here.y_m), (start.x_m + 4.0, start.y_m + 3.0)) < 0.7

            # the switch of the safety pilot's transmitter arrives by radio frames
            switch, control = (
                m.reader("vehicle/switch", SafetySwitch),
                m.reader("control/state", ControlState),
            )
            await m.request(
                "sys/sim/switch", SwitchRequest(VehicleMode.MANUAL), SafetySwitch, timeout_s=PATIENCE_S
            )
            await until_value(control, lambda state: state.mode is DriveMode.PILOT)
            assert switch.value == SafetySwitch(VehicleMode.MANUAL)
            await until_value(vehicle, lambda state: state.mode is VehicleMode.MANUAL)
            await m.request(
                "sys/sim/switch", SwitchRequest(VehicleMode.AUTO), SafetySwitch, timeout_s=PATIENCE_S
            )
            await until_value(vehicle, lambda state: state.mode is VehicleMode.AUTO)

            goals.write(Goal(3, GoalKind.LAND))
            await until_value(status, lambda s: s.goal_seq == 3 and s.state == "arrived")
            assert (await m.request(ARM, ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)).landed

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_airframe_flies_by_sensor_lines_and_motor_pulses(
    tmp_path: Path,
) -> None:
    lines = tmp_path / "dev"

    async def fly() -> None:
        config_dir = pulsed_node(tmp_path)
        async with (
            spawn(config_dir, "sim", "hal", "control", "navigator"),
            Module("test", config_dir=config_dir) as m,
        ):
            goals, status = m.writer("nav/goal", Goal), m.reader("nav/status", NavStatus)
            truth, vehicle = m.reader("sim/truth", Pose), m.reader("vehicle/state", VehicleState)
            await until_value(m.reader("nav/pose", Pose), lambda _: True)
            async with asyncio.timeout(PATIENCE_S):
                while vehicle.value is None or not vehicle.value.armed:
                    with suppress(Denied):  # until the attitude is known
                        await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)
            goals.write(Goal(1, GoalKind.TAKEOFF, z_m=3.0, speed_m_s=1.5))
            await until_value(status, lambda s: s.goal_seq == 1 and s.state == "arrived")
            await until_value(vehicle, lambda state: not state.landed)
            here = truth.value
            assert here is not None
            assert here.z_m == pytest.approx(3.0, abs=0.7)
            goals.write(Goal(2, GoalKind.LAND))
            await until_value(status, lambda s: s.goal_seq == 2 and s.state == "arrived")
            await until_value(truth, lambda pose: pose.z_m < 0.05)
            await until_value(vehicle, lambda state: state.landed)
            assert not (await m.request(ARM, ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)).armed
            async with asyncio.timeout(PATIENCE_S):
                while (lines / "pwmchip0/pwm0/duty_cycle").read_text() != "1000000\n":
                    await truth.changed()

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_unplugged_devices_are_awaited_and_vehicle_arms_again(tmp_path: Path) -> None:
    async def replug() -> None:
        config_dir = serial_node(tmp_path)
        async with spawn(config_dir, "hal"), Module("test", config_dir=config_dir) as m:
            drivers = m.reader("hal/drivers", DriverTable)
            table = await until_value(drivers, lambda table: all(one.note for one in table.drivers))
            assert all("no such device" in one.note for one in table.drivers)
            for _ in range(2):
                async with spawn(config_dir, "sim"):
                    await until_value(
                        drivers, lambda table: all(one.state == "running" for one in table.drivers)
                    )
                    await until_value(m.reader("vehicle/state", VehicleState), lambda state: state.landed)
                    assert (await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)).armed
                await until_value(drivers, lambda table: all(one.state == "waiting" for one in table.drivers))

    with no_leaks(tmp_path):
        asyncio.run(replug())


def test_plugged_device_gets_driver_and_tree_branch(tmp_path: Path) -> None:
    async def plug() -> None:
        folder = tmp_path / "dev/serial/by-id"
        rule = RecognitionRule(path=f"{folder}/gnss*", driver="nmea", settings={"path": "sensor/gnss_left"})
        hal = HalConfig(drivers=("system",), recognise=(rule,))
        config_dir = make_node(tmp_path, services={"hal": hal})
        async with spawn(config_dir, "tree", "hal"), Module("test", config_dir=config_dir) as m:

            async def entries() -> list[TreeEntry]:
                found = await m.request(
                    "sys/tree/list", TreeList("sensor/gnss_left"), TreeListing, timeout_s=PATIENCE_S
                )
                return list(found.entries)

            await m.reader("hal/drivers", DriverTable).changed(PATIENCE_S)
            assert await entries() == []
            line = PseudoTerminal(folder / "gnss0", lambda data: None)
            fixes = m.reader("sensor/gnss_left", GnssFix)
            async with asyncio.timeout(PATIENCE_S):
                while fixes.value is None or not await entries():
                    line.write(fix_sentences(GnssFix(48.0, 11.0, 500.0, 0.02, 12), 3600.0))
                    with suppress(NoAnswer):
                        await fixes.changed(0.2)
            (entry,) = await entries()
            assert entry.type == "GnssFix"
            line.close()

    with no_leaks(tmp_path):
        asyncio.run(plug())
