"""The port of the simulated chassis, which receives the orders of its driver in shared memory."""

from collections.abc import Callable, Iterable

from swarmd.sim.core.vehicle_core import Action, VehicleCore
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.types.chassis import ChassisOrder


class ChassisPort:
    """Executes orders of the driver as soon as they are written."""

    def __init__(self, module: Module, core: VehicleCore, feed: Callable[[Iterable[Action]], None]) -> None:
        self._module = module
        self._core = core
        self._feed = feed
        # orders from before this start are skipped, because the driver repeats unanswered orders
        self._orders = module.stream_reader(paths.SIM_ORDERS, ChassisOrder)

    def serve(self) -> None:
        """Starts to execute orders."""
        self._module.start(self._follow(), "orders to the chassis")

    async def _follow(self) -> None:
        async for order in self._orders:
            self._feed(self._core.on_order(order, self._module.now_ns()))
