"""Services that the tests of the runner start."""

import asyncio
import os
import time
from typing import Annotated

import msgspec

from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.service.service import Service
from swarmware.types.scalar import Int, Text


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `steady`."""

    start: Annotated[int, msgspec.Meta(ge=0)] = 1
    """First number."""


class Steady(Service):
    """Counts, answers, and saves its count when it is asked to stop."""

    name = "steady"
    Config = Settings

    def __init__(self, module: Module, config: Settings) -> None:
        super().__init__(module, config)
        self._start = config.start

    async def run(self) -> None:
        count = self.module.writer("test/count", Int)
        self.module.serve("test/pid", Int, lambda request, meta: Int(os.getpid()))
        self.module.serve("test/block", Int, self._block)
        async for tick in self.module.every(0.02):
            count.write(Int(self._start + tick))

    async def _block(self, request: Int, meta: Meta) -> Int:
        time.sleep(request.value / 1000)  # noqa: ASYNC251 - this is what the test is about
        return request

    async def stop(self) -> None:
        await asyncio.sleep(0.05)
        (self.module.node.config.data_path / "stopped").write_text("orderly")


class TempSensor(Service):
    """A service of a name with a hyphen: counts, and takes the number to go on with."""

    name = "temp-sensor"
    Config = Settings

    async def run(self) -> None:
        board = self.module.writer("sensor/temperature", Int, rate_hz=10)
        board.write(Int(self.config.start))
        async for order in self.module.inbox("sensor/offset", Int):
            board.write(order)


class Fragile(Service):
    """Fails or returns on request."""

    name = "fragile"

    async def run(self) -> None:
        board = self.module.writer("test/fragile", Text)
        board.write(Text(f"life {self.module.now_ns()}"))
        async for order in self.module.inbox("test/order", Text):
            if order.value == "return":
                return
            raise ValueError(order.value)


class Stubborn(Service):
    """Does not finish when it is asked to."""

    name = "stubborn"

    async def run(self) -> None:
        await asyncio.Event().wait()

    async def stop(self) -> None:
        await asyncio.Event().wait()
