"""A chassis on a test bench."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec

from swarmd.hal.chassis import Chassis
from swarmd.hal.config import ChassisConfig
from swarmd.hal.motors import Motors
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import Setpoint

REST = ChassisReport(armed=False, landed=True)


class Bench(Chassis):
    """A simulated chassis, which answers each order unless it is set to lose orders."""

    def __init__(self, **config: Any) -> None:
        super().__init__("bench", ChassisConfig(**config))
        self.report = REST
        self.setpoints: list[Setpoint] = []
        self.orders: list[ChassisOrder] = []
        self.loses = 0
        self.refuses = ""

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        self.setpoints.append(setpoint)

    def send_order(self, order: ChassisOrder) -> None:
        self.orders.append(order)
        if self.loses:
            self.loses -= 1
            return
        armed = self.report.armed
        if not self.refuses:
            armed = order.action is ChassisAction.ARM or (armed and order.action is ChassisAction.GAINS)
        self.report_as(
            msgspec.structs.replace(self.report, armed=armed, answered=order.number, refused=self.refuses)
        )

    def report_as(self, report: ChassisReport) -> None:
        assert self.module is not None
        self.report = report
        self.on_report(report, self.module.now_ns())


@asynccontextmanager
async def bench(root: Path, **config: Any) -> AsyncIterator[tuple[Bench, Module, Module]]:
    async with tmp_node(root) as node, Module("hal", node=node) as module, Module("test", node=node) as other:
        chassis = Bench(**config)
        await chassis.open(module)
        chassis.report_as(REST)
        Motors(module, chassis).serve()
        yield chassis, module, other
        await chassis.close()
