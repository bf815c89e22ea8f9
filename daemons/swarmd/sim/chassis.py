"""The port of the simulated chassis: executes the orders that its driver writes in shared memory."""

from collections.abc import Callable, Iterable

from swarmd.sim.core.vehicle_core import Action, VehicleCore
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.types.chassis import ChassisOrder


class ChassisPort:
    """Takes orders as soon as they are written."""

    def __init__(self, module: Module, core: VehicleCore, feed: Callable[[Iterable[Action]], None]) -> None:
        self._module = module
        self._core = core
        self._feed = feed
        # orders from before this start are not executed: the driver repeats those that it still needs
        self._orders = module.stream_reader(paths.SIM_ORDERS, ChassisOrder)

    def serve(self) -> None:
        """Starts to take orders."""
        self._module.start(self._follow(), "orders to the chassis")

    async def _follow(self) -> None:
        async for order in self._orders:
            self._feed(self._core.on_order(order, self._module.now_ns()))
