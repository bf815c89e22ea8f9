"""The simulated devices: what service `sim` computes, as a real device would deliver it."""

from typing import Generic, TypeVar

import msgspec

from swarmd.hal.config import Config
from swarmd.hal.core.median import MedianFilter
from swarmd.hal.driver import Driver, Site
from swarmware.module import BoardReader, BoardWriter, Module
from swarmware.types.scalar import Float
from swarmware.types.vehicle import BatteryState, GnssFix, Imu, Range

T = TypeVar("T", bound=msgspec.Struct)


class SimDevice(Driver, Generic[T]):
    """A device whose values pass as they are; stamps stay those of the measurement."""

    def __init__(self, device: str, path: str, cls: type[T], rate_hz: float) -> None:
        self.name = f"sim.{device}"
        self.period_s = 1 / rate_hz
        self._source = f"sim/sensors/{device}"
        self._path = path
        self._cls = cls
        self._rate_hz = rate_hz
        self._reader: BoardReader[T] | None = None
        self._module: Module | None = None
        self._writer: BoardWriter[T] | None = None
        self._sequence = 0

    async def open(self, module: Module) -> None:
        """The board of the simulation; it may not be there yet."""
        self._module = module
        self._reader = await module.reader(self._source, self._cls)
        self._writer = await module.writer(self._path, self._cls, rate_hz=self._rate_hz)

    async def read(self, now_ns: int) -> bool:
        """The newest value, once."""
        reader, writer = self._reader, self._writer
        if reader is None or writer is None:
            return False
        value = reader.value
        if value is None or reader.sequence == self._sequence:
            return False
        self._sequence = reader.sequence
        writer.write(value, reader.stamp_ns)
        return True

    async def close(self) -> None:
        """Both ends."""
        if self._reader is not None:
            self._reader.close()
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
        self._reader = self._writer = None


class SimSonar(Driver):
    """The sonar below a vehicle that flies: height above the ground, freed from wrong echoes."""

    name = "sim.sonar"

    def __init__(self, rate_hz: float, window: int) -> None:
        self.period_s = 1 / rate_hz
        self._filter = MedianFilter(window)
        self._reader: BoardReader[Range] | None = None
        self._module: Module | None = None
        self._writer: BoardWriter[Float] | None = None
        self._sequence = 0

    async def open(self, module: Module) -> None:
        """The board of the simulation; it may not be there yet."""
        self._module = module
        self._filter.reset()
        self._reader = await module.reader("sim/sensors/sonar", Range)
        # without a rate: above the sonar's reach it is silent, and that is no fault
        self._writer = await module.writer("sensor/height", Float, unit="m", link="request")

    async def read(self, now_ns: int) -> bool:
        """The newest echo through the filter; out of reach of the ground there is nothing to tell."""
        reader, writer = self._reader, self._writer
        if reader is None or writer is None:
            return False
        scan = reader.value
        if scan is None or reader.sequence == self._sequence or not scan.ranges_m:
            return False
        self._sequence = reader.sequence
        height_m = self._filter.add(scan.ranges_m[0])
        if height_m >= scan.max_m:
            return False
        writer.write(Float(round(height_m, 3)), reader.stamp_ns)
        return True

    async def close(self) -> None:
        """Both ends."""
        if self._reader is not None:
            self._reader.close()
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
        self._reader = self._writer = None


def make(config: Config, site: Site) -> list[Driver]:
    """The devices of a simulated vehicle; a ground station has none."""
    rates = config.sim
    if site.kind == "gcs":
        return []
    found: list[Driver] = [
        SimDevice("gnss", "sensor/gnss", GnssFix, rates.gnss_hz),
        SimDevice("imu", "sensor/imu", Imu, rates.imu_hz),
        SimDevice("range", "sensor/range", Range, rates.range_hz),
        SimDevice("battery", "power/battery", BatteryState, rates.battery_hz),
    ]
    if site.kind == "uav":
        found.append(SimSonar(rates.sonar_hz, rates.sonar_window))
    return found
