"""Driver of a simulated airframe, whose flight controller sends its outputs to service `sim`."""

from swarmd.hal.config import ChassisConfig
from swarmd.hal.core.flight.control_law import ControlLaw
from swarmd.hal.core.flight.flight_core import FlightTiming
from swarmd.hal.drivers.sim_port import SimPort
from swarmd.hal.flight_controller import FlightController
from swarmd.hal.imu_source import ImuSource
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.types.chassis import ActuatorOutputs, ChassisOrder


class SimFlight(ImuSource, FlightController):
    """Flight controller whose inertial unit and motors are simulated."""

    def __init__(
        self, config: ChassisConfig, controller: ControlLaw, timing: FlightTiming, imu_hz: float
    ) -> None:
        source = paths.simulated_sensor("imu")
        super().__init__("sim.flight", config, controller, timing, source, imu_hz)
        self._port = SimPort(paths.SIM_OUTPUTS, ActuatorOutputs)

    async def open(self, module: Module) -> None:
        """Opens the boards shared with the simulation, which may not run yet."""
        self.take_over(module)
        await super().open(module)
        self._port.open(module)
        self.start(self._port.follow(self.on_report))

    def send_outputs(self, outputs: ActuatorOutputs, stamp_ns: int) -> None:
        """Writes the outputs for the simulation."""
        self._port.command(outputs, stamp_ns)

    def carry_order(self, order: ChassisOrder) -> None:
        """Writes the order for the simulation."""
        self._port.order(order)

    async def close(self) -> None:
        """Closes the boards of the simulation."""
        await super().close()
        self._port.close()
