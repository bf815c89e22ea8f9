"""Driver of the simulated chassis, which service `sim` serves in shared memory."""

from typing import Final

from swarmd.hal.chassis import Chassis
from swarmd.hal.config import ChassisConfig
from swarmware.model import paths
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.streamwriter import StreamWriter
from swarmware.module.writer import BoardWriter
from swarmware.types.chassis import ChassisOrder, ChassisReport
from swarmware.types.vehicle import Setpoint

_ORDERS: Final = 16
"""Orders that remain readable for a simulation that is busy."""
_ORDER_BYTES: Final = 512


class SimChassis(Chassis):
    """The chassis of the simulated vehicle."""

    def __init__(self, config: ChassisConfig) -> None:
        super().__init__("sim.chassis", config)
        self._rate_hz = config.rate_hz
        self._setpoints: BoardWriter[Setpoint] | None = None
        self._orders: StreamWriter[ChassisOrder] | None = None
        self._reports: BoardReader[ChassisReport] | None = None

    async def open(self, module: Module) -> None:
        """Opens the boards that it shares with the simulation, which may not run yet."""
        await super().open(module)
        self._setpoints = module.writer(paths.SIM_SETPOINT, Setpoint)
        self._orders = module.stream_writer(
            paths.SIM_ORDERS, ChassisOrder, kind="event", slots=_ORDERS, slot_bytes=_ORDER_BYTES
        )
        self._reports = reports = module.reader(paths.SIM_REPORT, ChassisReport)
        self.start(self._follow(reports, module))

    async def _follow(self, reports: BoardReader[ChassisReport], module: Module) -> None:
        async for report in reports:
            self.on_report(report, reports.local_stamp_ns or module.now_ns())

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Writes the set-point for the simulation."""
        if self._setpoints is not None:
            self._setpoints.write(setpoint, stamp_ns)

    def send_order(self, order: ChassisOrder) -> None:
        """Writes the order for the simulation."""
        if self._orders is not None:
            self._orders.write(order)

    async def close(self) -> None:
        """Closes the boards of the simulation."""
        await super().close()
        if self._reports is not None:
            self._reports.close()
        if self.module is not None:
            for writer in (self._setpoints, self._orders):
                if writer is not None:
                    self.module.close_writer(writer)
        self._setpoints = self._orders = self._reports = None
