"""Driver of inertial units of InvenSense (MPU-6000 to ICM-20602) on SPI or I2C."""

from swarmd.hal.buses.registers import RegisterBus
from swarmd.hal.config import Config, InvensenseDriver
from swarmd.hal.core import invensense
from swarmd.hal.driver import Device, DeviceError, Site
from swarmd.hal.imu_source import ImuSource
from swarmd.hal.register_sensor import RegisterSensor
from swarmware.errors import ConfigError, WireError
from swarmware.module.module import Module
from swarmware.types.vehicle import Imu


class InvensenseImu(ImuSource, RegisterSensor[Imu]):
    """Publishes body rates and specific force at the rate of the driver."""

    def __init__(self, config: InvensenseDriver) -> None:
        if not invensense.is_right_handed(config.axes):
            raise ConfigError(
                f"services/hal.toml: key invensense.axes: {' '.join(config.axes)}, expected three different"
                " axes that form a right-handed system"
            )
        super().__init__("invensense", config, Imu, (invensense.DATA_BYTES,))
        self._axes = config.axes
        self._settled_ns = 0

    async def open(self, module: Module) -> None:
        """Opens the bus and the board."""
        await super().open(module)
        self._settled_ns = module.now_ns() + invensense.SETTLING_NS

    def begin(self, bus: RegisterBus) -> None:
        """Identifies the chip and starts it. Raises: DeviceError for another chip, or if it is not
        writable."""
        chip = bus.read(invensense.ID, 1)[0]
        if chip not in invensense.CHIPS:
            known = ", ".join(f"{name} ({number:#04x})" for number, name in invensense.CHIPS.items())
            raise DeviceError(f"{bus.path}: chip {chip:#04x}, expected one of {known}")
        for register, value in invensense.SETTINGS:
            bus.write(register, bytes([value]))
        # reads a register back, because a bus without a device accepts all writes
        register, value = invensense.SETTINGS[0]
        if (found := bus.read(register, 1)[0]) != value:
            raise DeviceError(f"{bus.path}: register {register:#04x} has {found:#04x}, expected {value:#04x}")

    def measured(self, bus: RegisterBus) -> Imu:
        """Reads all values in one transfer. Raises: DeviceError when the device is silent."""
        try:
            return invensense.measurement(bus.read(invensense.DATA, invensense.DATA_BYTES), self._axes)
        except WireError as error:
            raise DeviceError(f"{bus.path}: {error}") from error

    def publish(self, value: Imu, now_ns: int) -> bool:
        """Writes the board of the unit, but not before the gyroscope is stable."""
        return now_ns >= self._settled_ns and super().publish(self.corrected(value), now_ns)


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the inertial unit."""
    return [InvensenseImu(config.invensense)]
