"""Drivers of the simulated sensors, which publish the measurements of service `sim`."""

from contextlib import suppress
from typing import TYPE_CHECKING, Generic, TypeVar

import msgspec

from swarmd.hal.chassis import Chassis
from swarmd.hal.config import ChassisConfig, Config
from swarmd.hal.core.median import MedianFilter
from swarmd.hal.driver import Device, Sensor, Site
from swarmd.hal.drivers.sim_port import SimPort
from swarmd.hal.imu_source import ImuSource
from swarmware.errors import NoAnswer
from swarmware.model import paths
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.chassis import ChassisOrder
from swarmware.types.scalar import Float
from swarmware.types.vehicle import BatteryState, GnssFix, Imu, Range, Setpoint, VehicleState


class SimChassis(Chassis):
    """The chassis of the simulated vehicle."""

    def __init__(self, config: ChassisConfig) -> None:
        super().__init__("sim.chassis", config)
        self._port = SimPort(paths.SIM_SETPOINT, Setpoint)

    async def open(self, module: Module) -> None:
        """Opens the boards shared with the simulation, which may not run yet."""
        await super().open(module)
        self._port.open(module)
        self.start(self._port.follow(self.on_report))

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Writes the set-point for the simulation."""
        self._port.command(setpoint, stamp_ns)

    def send_order(self, order: ChassisOrder) -> None:
        """Writes the order for the simulation."""
        self._port.order(order)

    async def close(self) -> None:
        """Closes the boards of the simulation."""
        await super().close()
        self._port.close()


if TYPE_CHECKING:
    from swarmware.model.airframe import Airframe

T = TypeVar("T", bound=msgspec.Struct)


class RestPeriod:
    """Period of a device, which is longer while the vehicle is disarmed and on the ground."""

    def __init__(self, rate_hz: float, rest_hz: float) -> None:
        self._moving_s = 1 / rate_hz
        self._resting_s = 1 / min(rate_hz, rest_hz)
        self._reader: BoardReader[VehicleState] | None = None

    def open(self, module: Module) -> None:
        """Opens the board with the state of the vehicle, if both periods differ."""
        if self._resting_s > self._moving_s:
            self._reader = module.reader("vehicle/state", VehicleState)

    @property
    def period_s(self) -> float:
        """The period in force now."""
        state = None if self._reader is None else self._reader.value
        return self._resting_s if state is not None and state.resting else self._moving_s

    def close(self) -> None:
        """Closes the board of the vehicle."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None


async def fresh(reader: BoardReader[T], taken: int, period_s: float) -> bool:
    """True if there is a value newer than the sequence number `taken`; waits half a period for a late value.

    Without the wait, values of a simulation that runs a millisecond after its driver would be a period old.
    """
    if reader.value is None:
        return False
    if reader.sequence == taken:
        with suppress(NoAnswer):
            await reader.changed(timeout_s=period_s / 2)
    return reader.sequence != taken


class SimSensor(Sensor, Generic[T]):
    """Driver of a simulated sensor, which passes values and stamps through."""

    def __init__(self, device: str, path: str, cls: type[T], rate_hz: float, rest_hz: float) -> None:
        self.name = f"sim.{device}"
        self._period = RestPeriod(rate_hz, rest_hz)
        self.period_s = self._period.period_s
        self._source = paths.simulated_sensor(device)
        self._path = path
        self._cls = cls
        self._rate_hz = rate_hz
        self._reader: BoardReader[T] | None = None
        self._module: Module | None = None
        self._writer: BoardWriter[T] | None = None
        self._sequence = 0

    async def open(self, module: Module) -> None:
        """Opens the board of the simulation, which may not exist yet."""
        self._module = module
        self._period.open(module)
        self._reader = module.reader(self._source, self._cls)
        self._writer = module.writer(self._path, self._cls, rate_hz=self._rate_hz)

    async def read(self, now_ns: int) -> bool:
        """Publishes the newest value, once."""
        reader, writer = self._reader, self._writer
        if reader is None or writer is None:
            return False
        self.period_s = self._period.period_s
        if not await fresh(reader, self._sequence, self.period_s):
            return False
        value = reader.value
        assert value is not None
        self._sequence = reader.sequence
        writer.write(self.passed(value), reader.local_stamp_ns)
        return True

    def passed(self, value: T) -> T:
        """Value that is published for a value of the simulation."""
        return value

    async def close(self) -> None:
        """Closes readers and writer."""
        self._period.close()
        if self._reader is not None:
            self._reader.close()
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
        self._reader = self._writer = None


class SimImu(ImuSource, SimSensor[Imu]):
    """The simulated inertial unit, with the calibration of a real unit."""

    def passed(self, value: Imu) -> Imu:
        """The sample with the correction applied."""
        return self.corrected(value)


class SimSonar(Sensor):
    """The simulated sonar of an air vehicle, which publishes the height with outlier rejection."""

    name = "sim.sonar"

    def __init__(self, rate_hz: float, rest_hz: float, window: int) -> None:
        self._period = RestPeriod(rate_hz, rest_hz)
        self.period_s = self._period.period_s
        self._filter = MedianFilter(window)
        self._reader: BoardReader[Range] | None = None
        self._module: Module | None = None
        self._writer: BoardWriter[Float] | None = None
        self._sequence = 0

    async def open(self, module: Module) -> None:
        """Opens the board of the simulation, which may not exist yet."""
        self._module = module
        self._filter.reset()
        self._period.open(module)
        self._reader = module.reader("sim/sensors/sonar", Range)
        # without a rate, because a sonar out of range publishes nothing, which is not a fault
        self._writer = module.writer("sensor/height", Float, unit="m", link="request")

    async def read(self, now_ns: int) -> bool:
        """Publishes the filtered height, unless the ground is out of range."""
        reader, writer = self._reader, self._writer
        if reader is None or writer is None:
            return False
        self.period_s = self._period.period_s
        scan = reader.value if await fresh(reader, self._sequence, self.period_s) else None
        if scan is None or not scan.ranges_m:
            return False
        self._sequence = reader.sequence
        height_m = self._filter.add(scan.ranges_m[0])
        if height_m >= scan.max_m:
            return False
        writer.write(Float(round(height_m, 3)), reader.local_stamp_ns)
        return True

    async def close(self) -> None:
        """Closes readers and writer."""
        self._period.close()
        if self._reader is not None:
            self._reader.close()
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
        self._reader = self._writer = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the drivers of a simulated vehicle; a ground station has no drivers."""
    rates = config.sim
    if site.kind == PlatformKind.GCS:
        return []
    rest_hz = rates.rest_hz
    found: list[Device] = [
        SimSensor("gnss", "sensor/gnss", GnssFix, rates.gnss_hz, rest_hz),
        SimSensor("range", "sensor/range", Range, rates.range_hz, rest_hz),
        SimSensor("battery", "power/battery", BatteryState, rates.battery_hz, rest_hz),
    ]
    if site.airframe is not None:
        found.append(_flight(config, site.airframe))
    else:
        found += [
            SimImu("imu", "sensor/imu", Imu, rates.imu_hz, rest_hz),
            SimChassis(config.chassis),
        ]
    if site.kind == PlatformKind.UAV:
        found.append(SimSonar(rates.sonar_hz, rest_hz, rates.sonar_window))
    return found


def _flight(config: Config, airframe: "Airframe") -> Device:
    """Creates the flight controller of an airframe."""
    from swarmd.hal.core.flight.flight_core import control_law, flight_timing  # not loaded by other vehicles
    from swarmd.hal.drivers.sim_flight import SimFlight

    return SimFlight(config.chassis, control_law(airframe), flight_timing(airframe), config.sim.imu_hz)
