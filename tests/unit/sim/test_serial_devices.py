"""The serial devices of a simulated vehicle send the protocols that the drivers of real devices read."""

import pytest

from swarmd.sim.core.serial_devices import SerialDevice, SerialDevices, SerialOutput
from swarmd.sim.core.simulation import SimulationOutput
from swarmware.devices.chassis_frames import (
    Telemetry,
    frame_decoder,
    framed,
    order_frame,
    setpoint_frame,
    telemetry,
)
from swarmware.devices.crsf import CrsfDecoder, RcChannels, RcLink
from swarmware.devices.gnss_receiver import ReceiverDecoder
from swarmware.devices.maxbotix import SonarDecoder, SonarUnit
from swarmware.devices.vectornav import VectorNavDecoder
from swarmware.geometry.attitude import from_euler
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import BatteryState, GnssFix, Imu, Pose, Range, Setpoint, VehicleMode

S = 1_000_000_000
NOW = 50_000 * S
FIX = GnssFix(48.1, 11.5, 520.25, 0.036, 17)
IMU = Imu(0.0, 0.0, 0.5, 0.0, 0.0, 9.8, 1.25)
ARMED = ChassisReport(armed=True, landed=False, answered=7)


def sent(outputs: list[SerialOutput], device: SerialDevice) -> bytes:
    return b"".join(output.data for output in outputs if output.device is device)


def reports(outputs: list[SerialOutput]) -> list[Telemetry]:
    return [telemetry(body) for body in frame_decoder().feed(sent(outputs, SerialDevice.CHASSIS))]


def test_each_measurement_uses_protocol_of_device() -> None:
    devices = SerialDevices(0.5)
    sonar = Range(0.0, 0.0, 6.45, (2.125,))
    out = devices.on_output(
        SimulationOutput(NOW, Pose(0.0, 0.0), gnss=FIX, imu=IMU, sonar=sonar), VehicleMode.MANUAL
    )
    (fix,) = ReceiverDecoder().feed(sent(out, SerialDevice.GNSS))
    assert [fix.lat_deg, fix.h_acc_m, fix.satellites] == pytest.approx([48.1, 0.036, 17])
    (imu,) = VectorNavDecoder().feed(sent(out, SerialDevice.IMU))
    assert [imu.wz_rad_s, imu.yaw_rad] == pytest.approx([0.5, 1.25])
    assert list(SonarDecoder(SonarUnit.MM).feed(sent(out, SerialDevice.SONAR))) == [2.125]
    (channels,) = CrsfDecoder().feed(sent(out, SerialDevice.RC))
    assert isinstance(channels, RcChannels)
    assert channels.positions[5] == 1.0
    assert reports(out) == [], "the chassis has not reported yet"


def test_unit_measures_roll_and_pitch_of_vehicle() -> None:
    qx, qy, qz, qw = from_euler(0.1, -0.2, 1.25)
    tilted = Pose(0.0, 0.0, qx=qx, qy=qy, qz=qz, qw=qw)
    out = SerialDevices(0.5).on_output(SimulationOutput(NOW, tilted, imu=IMU), VehicleMode.AUTO)
    (imu,) = VectorNavDecoder().feed(sent(out, SerialDevice.IMU))
    assert [imu.roll_rad, imu.pitch_rad, imu.yaw_rad] == pytest.approx([0.1, -0.2, 1.25])


def test_measurement_that_is_not_due_is_not_sent() -> None:
    assert SerialDevices(0.5).on_output(SimulationOutput(NOW, Pose(0.0, 0.0)), VehicleMode.AUTO) == []


def test_chassis_reports_periodically_and_after_orders() -> None:
    devices = SerialDevices(0.5)
    battery = BatteryState(24.5, 8.0, 0.75)

    def at(ms: int, report: ChassisReport | None = None) -> list[Telemetry]:
        output = SimulationOutput(NOW + ms * 1_000_000, Pose(0.0, 0.0), report=report, battery=battery)
        return reports(devices.on_output(output, VehicleMode.AUTO))

    assert [found.report for found in at(0, ChassisReport(False, True))] == [ChassisReport(False, True)]
    assert at(50) == []
    assert at(100)[0].battery == battery
    (found,) = reports(devices.on_report(ARMED, NOW + 120_000_000))
    assert found.report == ARMED
    assert found.failsafe, "armed, and no set-point ever arrived"
    assert at(150) == []


def test_receiver_reports_its_link_with_battery_once_second() -> None:
    output = SimulationOutput(NOW, Pose(0.0, 0.0), battery=BatteryState(24.5, 8.0, 0.75))
    out = SerialDevices(0.5).on_output(output, VehicleMode.AUTO)
    assert list(CrsfDecoder().feed(sent(out, SerialDevice.RC))) == [RcLink(1.0)]


def test_set_points_end_fail_safe_orders_pass() -> None:
    devices = SerialDevices(0.5)
    order = ChassisOrder(9, ChassisAction.ARM)
    data = order_frame(order) + setpoint_frame(Setpoint(1.0, 0.0, 0.5, 0.0)) + framed(b"\x55") + b"\x02"
    assert devices.on_bytes(data, NOW) == [order, Setpoint(1.0, 0.0, 0.5, 0.0)]
    assert devices.refused == 1
    (fresh,) = reports(devices.on_report(ARMED, NOW + S // 2))
    (old,) = reports(devices.on_report(ARMED, NOW + S // 2 + 1))
    assert (fresh.failsafe, old.failsafe) == (False, True)
