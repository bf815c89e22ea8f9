"""Drivers of the simulated sensors, which publish the measurements of service `sim`."""

from abc import abstractmethod
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
U = TypeVar("U", bound=msgspec.Struct)


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


class SimSensor(Sensor, Generic[T, U]):
    """Driver of a simulated sensor, which publishes each value of the simulation with its stamp."""

    def __init__(self, device: str, cls: type[T], rate_hz: float, rest_hz: float) -> None:
        self.name = f"sim.{device}"
        self._period = RestPeriod(rate_hz, rest_hz)
        self.period_s = self._period.period_s
        self._source = paths.simulated_sensor(device)
        self._cls = cls
        self._reader: BoardReader[T] | None = None
        self._writer: BoardWriter[U] | None = None
        self._sequence = 0

    async def open(self, module: Module) -> None:
        """Opens the board of the simulation, which may not exist yet."""
        self._period.open(module)
        self._reader = module.reader(self._source, self._cls)
        self._writer = self.managed(module, self.publication(module))

    @abstractmethod
    def publication(self, module: Module) -> BoardWriter[U]:
        """Opens the board of the sensor."""

    @abstractmethod
    def measured(self, value: T) -> U | None:
        """Measurement of a value of the simulation, or None if the sensor gives none."""

    async def read(self, now_ns: int) -> bool:
        """Publishes the measurement of the newest value, once."""
        reader, writer = self._reader, self._writer
        if reader is None or writer is None:
            return False
        self.period_s = self._period.period_s
        if not await fresh(reader, self._sequence, self.period_s):
            return False
        value = reader.value
        assert value is not None
        self._sequence = reader.sequence
        measured = self.measured(value)
        if measured is None:
            return False
        writer.write(measured, reader.local_stamp_ns)
        return True

    async def close(self) -> None:
        """Closes readers and writer."""
        self._period.close()
        if self._reader is not None:
            self._reader.close()
        self._reader = self._writer = None
        await super().close()


class SimPassed(SimSensor[T, T]):
    """Driver of a simulated sensor whose values are published as they are."""

    def __init__(self, device: str, path: str, cls: type[T], rate_hz: float, rest_hz: float) -> None:
        super().__init__(device, cls, rate_hz, rest_hz)
        self._path = path
        self._rate_hz = rate_hz

    def publication(self, module: Module) -> BoardWriter[T]:
        """Opens the board of the sensor with its rate."""
        return module.writer(self._path, self._cls, rate_hz=self._rate_hz)

    def measured(self, value: T) -> T:
        """The value of the simulation, unchanged."""
        return value


class SimImu(ImuSource, SimPassed[Imu]):
    """The simulated inertial unit, with the calibration of a real unit."""

    def measured(self, value: Imu) -> Imu:
        """The sample with the correction applied."""
        return self.corrected(value)


class SimSonar(SimSensor[Range, Float]):
    """The simulated sonar of an air vehicle, which publishes the height with outlier rejection."""

    def __init__(self, rate_hz: float, rest_hz: float, window: int) -> None:
        super().__init__("sonar", Range, rate_hz, rest_hz)
        self._filter = MedianFilter(window)

    def publication(self, module: Module) -> BoardWriter[Float]:
        """Opens the board of the height, without a rate: a sonar out of range publishes nothing, which is
        not a fault."""
        # heights from before a restart would delay the first new ones
        self._filter.reset()
        return module.writer("sensor/height", Float, unit="m", link="request")

    def measured(self, value: Range) -> Float | None:
        """The filtered height, or None if the ground is out of range."""
        if not value.ranges_m:
            return None
        height_m = self._filter.add(value.ranges_m[0])
        return None if height_m >= value.max_m else Float(round(height_m, 3))


def make(config: Config, site: Site) -> list[Device]:
    """Creates the drivers of a simulated vehicle; a ground station has no drivers."""
    rates = config.sim
    if site.kind == PlatformKind.GCS:
        return []
    rest_hz = rates.rest_hz
    found: list[Device] = [
        SimPassed("gnss", "sensor/gnss", GnssFix, rates.gnss_hz, rest_hz),
        SimPassed("range", "sensor/range", Range, rates.range_hz, rest_hz),
        SimPassed("battery", "power/battery", BatteryState, rates.battery_hz, rest_hz),
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
