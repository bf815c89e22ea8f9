"""Port to the simulated chassis in shared memory, with commands, orders and reports."""

from collections.abc import Callable
from typing import Final, Generic, TypeVar

import msgspec

from swarmware.model import paths
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.streamwriter import StreamWriter
from swarmware.module.writer import BoardWriter
from swarmware.types.chassis import ChassisOrder, ChassisReport

T = TypeVar("T", bound=msgspec.Struct)

_ORDERS: Final = 16
"""Number of orders that stay readable for a busy simulation."""
_ORDER_BYTES: Final = 512


class SimPort(Generic[T]):
    """Boards that a driver shares with service `sim`, which may not run yet.

    `path`: board of the commands, which are set-points or outputs of a flight controller.
    """

    def __init__(self, path: str, cls: type[T]) -> None:
        self._path = path
        self._cls = cls
        self._module: Module | None = None
        self._commands: BoardWriter[T] | None = None
        self._orders: StreamWriter[ChassisOrder] | None = None
        self._reports: BoardReader[ChassisReport] | None = None

    def open(self, module: Module) -> None:
        """Opens the boards for both directions."""
        self._module = module
        self._commands = module.writer(self._path, self._cls)
        self._orders = module.stream_writer(
            # a stream and not a board, because no order may be overwritten unread
            paths.SIM_ORDERS,
            ChassisOrder,
            kind="event",
            slots=_ORDERS,
            slot_bytes=_ORDER_BYTES,
        )
        self._reports = module.reader(paths.SIM_REPORT, ChassisReport)

    async def follow(self, take: Callable[[ChassisReport, int], None]) -> None:
        """Passes each report on with the instant of its creation, until the port is closed."""
        reports, module = self._reports, self._module
        if reports is None or module is None:
            return
        async for report in reports:
            take(report, reports.local_stamp_ns or module.now_ns())

    def command(self, value: T, stamp_ns: int) -> None:
        """Writes a command for the simulation."""
        if self._commands is not None:
            self._commands.write(value, stamp_ns)

    def order(self, order: ChassisOrder) -> None:
        """Writes an order for the simulation."""
        if self._orders is not None:
            self._orders.write(order)

    def close(self) -> None:
        """Closes the boards for both directions."""
        if self._reports is not None:
            self._reports.close()
        if self._module is not None:
            for writer in (self._commands, self._orders):
                if writer is not None:
                    self._module.close_writer(writer)
        self._commands = self._orders = self._reports = None
