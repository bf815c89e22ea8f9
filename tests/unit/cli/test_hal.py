"""`swarmctl hal`: the drivers of platforms as a table and a document, and the calibration of one vehicle."""

import pytest
from tests.unit.cli.session import COPY, ScriptedSession

from swarmctl.commands.hal.calibration import calibrate_motors, calibrate_sensor
from swarmctl.commands.hal.drivers import list_drivers
from swarmware.errors import Denied, NoAnswer, Partial
from swarmware.types import registry
from swarmware.types.chassis import SensorCalibrated, SensorCalibrationKind
from swarmware.types.driver import DriverState, DriverStatus, DriverTable
from swarmware.types.tree import Quality, TreeValue
from swarmware.types.vehicle import VehicleState

IMU = DriverStatus("imu", DriverState.RUNNING, 300.0, 299.7, 1.93, 900, 2, 1, "", False, 0.84)
CHASSIS = DriverStatus("wheels", DriverState.FAILSAFE, 20.0, 20.0, 0.5, 9, 0, 0, "no set-point", True)
BOARD = f"{COPY} /uav1/hal/drivers"


def board(*drivers: DriverStatus) -> TreeValue:
    data = registry.encode(DriverTable(drivers))
    return TreeValue("/uav1/hal/drivers", "DriverTable", data, 1, 1, 1, 0.2, Quality.LIVE)


async def test_drivers_are_listed_with_rates_and_lateness() -> None:
    session = ScriptedSession({BOARD: board(IMU, CHASSIS)}, node="uav1")
    await list_drivers(session)
    head, imu, wheels = session.stdout.getvalue().splitlines()[-3:]
    assert head.split()[:3] == ["PLATFORM", "DRIVER", "STATE"]
    assert imu.split() == ["uav1", "imu", "running", "300", "299.7", "0.8", "1.9", "1", "2", "-"]
    assert wheels.split()[:3] == ["uav1", "wheels", "failsafe"]
    assert wheels.endswith("no set-point")


async def test_document_has_whole_status_of_each_driver() -> None:
    session = ScriptedSession({BOARD: board(CHASSIS)}, node="uav1", output="json")
    await list_drivers(session)
    (platform,) = session.document["platforms"]
    assert platform["drivers"][0]["actuator"] is True
    assert platform["drivers"][0]["note"] == "no set-point"


async def test_a_platform_that_does_not_answer_is_named() -> None:
    session = ScriptedSession(
        {
            BOARD: NoAnswer("uav1: no answer"),
            "/uav1/sys/tree/get /uav1/hal/drivers": NoAnswer("uav1: no answer"),
        },
        node="{uav,ugv}1",
    )
    with pytest.raises(Partial, match="1 of 1 platforms did not answer"):
        await list_drivers(session)
    assert "no answer" in session.stderr.getvalue()


async def test_calibration_is_confirmed_or_refusal_shown() -> None:
    path = "/uav1/sys/vehicle/calibrate"
    session = ScriptedSession({path: VehicleState(armed=False, landed=True)})
    await calibrate_motors(session, "uav1")
    assert (
        "uav1: the motor controllers are being calibrated"
        in session.stdout.getvalue() + session.stderr.getvalue()
    )
    with pytest.raises(Denied, match="disarmed"):
        await calibrate_motors(ScriptedSession({path: Denied("expected a disarmed vehicle")}), "uav1")


async def test_inertial_calibration_names_what_is_missing() -> None:
    path = "/uav1/sys/vehicle/calibrate_sensor"
    taken = SensorCalibrated("sim.imu", SensorCalibrationKind.ACCELEROMETER, "level taken", ("nose up",))
    session = ScriptedSession({path: taken})
    await calibrate_sensor(session, "uav1", "accelerometer", None, "")
    assert "uav1: sim.imu: level taken" in session.stdout.getvalue()
    assert "still missing: nose up" in session.stderr.getvalue()
    done = SensorCalibrated("sim.imu", SensorCalibrationKind.COMPASS, "heading corrected by 3.0°")
    document = ScriptedSession({path: done}, output="json")
    await calibrate_sensor(document, "uav1", "compass", 90.0, "")
    assert document.document["sensor"]["text"] == "heading corrected by 3.0°"
    assert document.document["vehicle"] is None
