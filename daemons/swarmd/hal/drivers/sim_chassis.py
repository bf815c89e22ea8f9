"""Driver of the simulated chassis, which is connected to service `sim` by shared memory."""

from swarmd.hal.chassis import Chassis
from swarmd.hal.config import ChassisConfig
from swarmd.hal.drivers.sim_port import SimPort
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.types.chassis import ChassisOrder
from swarmware.types.vehicle import Setpoint


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
