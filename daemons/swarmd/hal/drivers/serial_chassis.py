"""Driver of a chassis on a serial line, whose firmware implements `chassis-protocol.md`."""

from typing import Final

from swarmd.hal.buses.serial_line import SerialLine
from swarmd.hal.chassis import Chassis
from swarmd.hal.config import Config
from swarmd.hal.core.line_load import serial_use
from swarmd.hal.driver import Device, Site
from swarmware.devices.chassis_frames import Telemetry, frame_decoder, order_frame, setpoint_frame, telemetry
from swarmware.errors import WireError
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.chassis import ChassisOrder
from swarmware.types.vehicle import BatteryState, Setpoint

_BATTERY_NS: Final = 1_000_000_000
"""Minimum time between two values of `power/battery`."""


class SerialChassis(Chassis):
    """A chassis whose controller is at the other end of a serial line."""

    def __init__(self, config: Config) -> None:
        super().__init__("serial_chassis", config.chassis)
        self._serial = config.serial_chassis
        bytes_s = len(setpoint_frame(Setpoint(0.0))) * config.chassis.rate_hz
        self.line_uses = (serial_use(self._serial.device, self._serial.baud, bytes_s),)
        self._line: SerialLine | None = None
        self._decoder = frame_decoder()
        self._battery: BoardWriter[BatteryState] | None = None
        self._battery_ns = 0
        self._stopped_itself = False

    async def open(self, module: Module) -> None:
        """Opens the line to the device."""
        self._decoder, self._stopped_itself = frame_decoder(), False
        self._line = SerialLine(self._serial.device, self._serial.baud, self._take)
        await super().open(module)

    async def write(self, now_ns: int) -> bool:
        """Sends due set-points and orders. Raises: DeviceGone when the line is lost; DeviceError as every
        chassis."""
        if self._line is not None:
            self._line.check()
        return await super().write(now_ns)

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Writes the frame of the set-point."""
        if self._line is not None:
            self._line.write(setpoint_frame(setpoint))

    def send_order(self, order: ChassisOrder) -> None:
        """Writes the frame of the order."""
        if self._line is not None:
            self._line.write(order_frame(order))

    def _take(self, data: bytes) -> None:
        if self.module is None:
            return
        for frame in self._decoder.feed(data):
            try:
                found = telemetry(frame)
            except WireError as error:
                # counted and dropped: a damaged frame on a serial line is normal
                self._decoder.refused[str(error)] += 1
                continue
            now_ns = self.module.now_ns()
            self._stopped_itself = found.failsafe
            self._publish_battery(found, now_ns)
            self.on_report(found.report, now_ns)

    def _publish_battery(self, found: Telemetry, now_ns: int) -> None:
        # thinned here, as telemetry comes much more often than a battery changes
        if found.battery is None or self.module is None or now_ns - self._battery_ns < _BATTERY_NS:
            return
        # opened at the first value: a chassis without a gauge must not have the board
        if self._battery is None:
            writer = self.module.writer("power/battery", BatteryState, rate_hz=1.0)
            self._battery = self.managed(self.module, writer)
        self._battery_ns = now_ns
        self._battery.write(found.battery, now_ns)

    def failsafe(self, now_ns: int) -> str:
        """Reason of the fail-safe, including the watchdog of the chassis itself, or "" without a
        fail-safe."""
        return super().failsafe(now_ns) or (
            "the chassis stopped by its own watchdog" if self._stopped_itself else ""
        )

    async def close(self) -> None:
        """Closes the line and the boards."""
        if self._line is not None:
            self._line.close()
            self._line = None
        self._battery = None
        await super().close()


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the chassis."""
    return [SerialChassis(config)]
