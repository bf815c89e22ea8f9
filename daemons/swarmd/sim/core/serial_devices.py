"""Serial devices of the simulated vehicle, which encode measurements and decode commands to the chassis."""

from enum import StrEnum
from typing import Final

import msgspec

from swarmd.sim.core.simulation import SimulationOutput
from swarmware.devices.chassis_frames import Telemetry, command, frame_decoder, report_frame
from swarmware.devices.crsf import channels_frame, link_frame
from swarmware.devices.maxbotix import SonarUnit, reading
from swarmware.devices.nmea import fix_sentences
from swarmware.devices.vectornav import frame
from swarmware.errors import WireError
from swarmware.geometry.attitude import to_euler
from swarmware.types.chassis import ChassisOrder, ChassisReport
from swarmware.types.vehicle import BatteryState, Imu, Pose, Setpoint, VehicleMode

_REPORT_NS: Final = 100_000_000
"""Period of the reports of the chassis; its protocol allows 200 ms."""
_SWITCH: Final = 5
"""Index of the switch's channel, the sixth."""


class SerialDevice(StrEnum):
    """A device on a serial line, by the name of its file."""

    GNSS = "gnss"
    IMU = "imu"
    SONAR = "sonar"
    RC = "rc"
    CHASSIS = "chassis"


class SerialOutput(msgspec.Struct, frozen=True, gc=False):
    """Bytes that a device sends."""

    device: SerialDevice
    data: bytes


class SerialDevices:
    """Protocols of the devices, fed with the measurements of the simulation, which include sensor errors.

    `watchdog_s`: age of the set-point above which the chassis reports that its own watchdog has stopped it;
    `chassis`: True if there is a chassis with its own controllers.
    """

    def __init__(self, watchdog_s: float, *, chassis: bool = True) -> None:
        self.present = tuple(one for one in SerialDevice if chassis or one is not SerialDevice.CHASSIS)
        """Devices that have a serial line."""
        self._watchdog_ns = round(watchdog_s * 1e9)
        self._decoder = frame_decoder()
        self._report: ChassisReport | None = None
        self._battery: BatteryState | None = None
        self._reported_ns = 0
        self._setpoint_ns = 0
        self.refused = 0
        """Number of valid frames to the chassis with invalid content."""

    def on_output(self, output: SimulationOutput, switch: VehicleMode) -> list[SerialOutput]:
        """Takes the measurements of an instant and the switch's position; returns the bytes to send."""
        now_ns, sent = output.stamp_ns, list[SerialOutput]()
        if output.gnss is not None:
            sent.append(SerialOutput(SerialDevice.GNSS, fix_sentences(output.gnss, now_ns / 1e9)))
        if output.imu is not None:
            sent.append(SerialOutput(SerialDevice.IMU, frame(_with_attitude(output.imu, output.truth))))
            sent.append(SerialOutput(SerialDevice.RC, channels_frame(_positions(switch))))
        if output.sonar is not None:
            data = reading(output.sonar.ranges_m[0], SonarUnit.MM)
            sent.append(SerialOutput(SerialDevice.SONAR, data))
        if output.battery is not None:
            self._battery = output.battery
            sent.append(SerialOutput(SerialDevice.RC, link_frame(1.0)))
        if output.report is not None:
            self._report = output.report
        # at once when the state changes, since an order waits for its answer
        if output.report is not None or now_ns - self._reported_ns >= _REPORT_NS:
            sent += self._reports(now_ns)
        return sent

    def on_report(self, report: ChassisReport, now_ns: int) -> list[SerialOutput]:
        """Takes the report that answers an order, and sends it at once."""
        self._report = report
        return self._reports(now_ns)

    def _reports(self, now_ns: int) -> list[SerialOutput]:
        if self._report is None or SerialDevice.CHASSIS not in self.present:
            return []
        self._reported_ns = now_ns
        stopped = self._report.armed and now_ns - self._setpoint_ns > self._watchdog_ns
        content = Telemetry(self._report, stopped, self._battery)
        return [SerialOutput(SerialDevice.CHASSIS, report_frame(content))]

    def on_bytes(self, data: bytes, now_ns: int) -> list[Setpoint | ChassisOrder]:
        """Takes bytes from the driver of the chassis; returns the contained set-points and orders."""
        found: list[Setpoint | ChassisOrder] = []
        for body in self._decoder.feed(data):
            try:
                content = command(body)
            except WireError:
                # counted and dropped, as the firmware of a chassis does
                self.refused += 1
                continue
            if isinstance(content, Setpoint):
                self._setpoint_ns = now_ns
            found.append(content)
        return found


def _with_attitude(imu: Imu, truth: Pose) -> Imu:
    """The measurement with roll and pitch of the unit's internal filter, which is simulated without
    errors."""
    roll_rad, pitch_rad, _ = to_euler((truth.qx, truth.qy, truth.qz, truth.qw))
    return msgspec.structs.replace(imu, roll_rad=roll_rad, pitch_rad=pitch_rad)


def _positions(switch: VehicleMode) -> list[float]:
    """Channels of a transmitter with centred sticks and this position of the switch."""
    positions = [0.0] * (_SWITCH + 1)
    positions[_SWITCH] = -1.0 if switch is VehicleMode.AUTO else 1.0
    return positions
