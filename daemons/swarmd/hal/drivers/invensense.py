"""Driver of inertial units of InvenSense (MPU-6000 to ICM-20602) on SPI or I2C."""

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.buses.registers import RegisterBus, open_registers
from swarmd.hal.config import Config, InvensenseDriver
from swarmd.hal.core import invensense
from swarmd.hal.driver import Device, DeviceError, Site
from swarmware.errors import ConfigError, WireError
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import Imu


class InvensenseImu(BlockingSensor[Imu]):
    """Publishes body rates and specific force at the rate of the driver."""

    name = "invensense"

    def __init__(self, config: InvensenseDriver) -> None:
        if not invensense.is_right_handed(config.axes):
            raise ConfigError(
                f"services/hal.toml: key invensense.axes: {' '.join(config.axes)}, expected three different"
                " axes that form a right-handed system"
            )
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._bus: RegisterBus | None = None
        self._settled_ns = 0
        self._module: Module | None = None
        self._writer: BoardWriter[Imu] | None = None

    async def open(self, module: Module) -> None:
        """Opens the bus and the board."""
        await super().open(module)
        config, self._module = self._config, module
        self._settled_ns = module.now_ns() + invensense.SETTLING_NS
        self._writer = module.writer(config.path, Imu, rate_hz=config.rate_hz)

    def connect(self) -> None:
        """Finds the chip and starts it. Raises: DeviceError when it is another one, or not writable."""
        config = self._config
        self._bus = bus = open_registers(config.bus, config.device, config.address, config.speed_hz)
        chip = bus.read(invensense.ID, 1)[0]
        if chip not in invensense.CHIPS:
            known = ", ".join(f"{name} ({number:#04x})" for number, name in invensense.CHIPS.items())
            raise DeviceError(f"{bus.path}: chip {chip:#04x}, expected one of {known}")
        for register, value in invensense.SETTINGS:
            bus.write(register, bytes([value]))
        register, value = invensense.SETTINGS[0]
        if (found := bus.read(register, 1)[0]) != value:
            raise DeviceError(f"{bus.path}: register {register:#04x} has {found:#04x}, expected {value:#04x}")

    def measure(self) -> Imu:
        """Reads all values at once. Raises: DeviceError when the device is silent."""
        if self._bus is None:
            raise DeviceError(f"{self._config.device}: not open")
        try:
            data = self._bus.read(invensense.DATA, invensense.DATA_BYTES)
            return invensense.measurement(data, self._config.axes)
        except WireError as error:
            raise DeviceError(f"{self._bus.path}: {error}") from error

    def publish(self, value: Imu, now_ns: int) -> bool:
        """Writes the board of the unit; not before the gyroscope is stable."""
        if self._writer is None or now_ns < self._settled_ns:
            return False
        self._writer.write(value, now_ns)
        return True

    def disconnect(self) -> None:
        """Closes the bus in its thread."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    async def close(self) -> None:
        """Closes the board, and the bus."""
        await super().close()
        if self._module is not None and self._writer is not None:
            self._module.close_writer(self._writer)
            self._writer = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the inertial unit."""
    return [InvensenseImu(config.invensense)]
