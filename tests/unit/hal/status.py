"""The status of drivers as a running HAL publishes it, and a sensor that counts."""

import asyncio

from swarmd.hal.driver import Sensor
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.driver import DriverStatus, DriverTable
from swarmware.types.health import CheckReports


class Counter(Sensor):
    """A sensor that counts its reads, and can be unplugged."""

    def __init__(self, name: str, rate_hz: float) -> None:
        self.name, self.period_s = name, 1 / rate_hz
        self.plugged = True
        self.opened = 0

    async def open(self, module: Module) -> None:
        if not self.plugged:
            raise FileNotFoundError(f"{self.name} is unplugged")
        self.opened += 1

    async def read(self, now_ns: int) -> bool:
        if not self.plugged:
            raise OSError("gone")
        return True


async def status(board: BoardReader[DriverTable], name: str, **wanted: object) -> DriverStatus:
    """Waits until a driver has this status."""
    async with asyncio.timeout(20.0):
        while True:
            table = await board.changed()
            for found in table.drivers:  # a driver that is plugged in now comes with a later table
                if found.name == name and all(getattr(found, key) == value for key, value in wanted.items()):
                    return found


async def state_of(board: BoardReader[CheckReports], check: str, wanted: str) -> bool:
    async with asyncio.timeout(20.0):
        while True:
            reports = board.value
            if reports is not None and any(r.check == check and r.state == wanted for r in reports.reports):
                return True
            await board.changed()
