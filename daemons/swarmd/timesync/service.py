"""Shell of time synchronisation: reads clock differences from the broker's stream, publishes functions.

Direct neighbours cost no traffic: the stamps are part of the beacons that are sent anyway (S1.72). For
platforms out of direct range it requests the functions of the neighbours on the route to them.
"""

import asyncio
import contextlib

from swarmd.timesync import config as settings
from swarmd.timesync.core import (
    Action,
    ClockStepped,
    FunctionsRefused,
    PeerExchange,
    Publish,
    TimeCore,
    UnitRebooted,
)
from swarmd.timesync.peer import Exchange
from swarmware.errors import SwarmError
from swarmware.module.board import BoardReader
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.module.writer import BoardWriter
from swarmware.service.service import Service
from swarmware.types.net import Routes, TimingBatch, TimingSample
from swarmware.types.rpc import Empty
from swarmware.types.time import TimeFunctions

ASK_S = 10.0
"""Period of the requests to a neighbour: within 10 s the random walk of a quartz is below 0.1 µs."""
ASK_FIRST_S = 2.0
"""The same while a function is missing or new; also the time to wait for a direct exchange."""

YOUNG_SAMPLES = 30
"""Number of exchanges below which a function still improves much."""
MEASURED_DIRECTLY_NS = 10_000_000_000
"""Silence after which a platform is converted over others: its own function ages."""


class TimeSync(Service):
    """Publishes one conversion function for each clock of the swarm; clocks are never set."""

    name = "timesync"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node
        self._core = TimeCore(
            node.platform,
            node.config.unit,
            node.hardware,
            node.clock.boot_id,
            config,
            # grows with every restart of the service: others may still hold functions of the previous run
            first_epoch=(node.clock.now_ns() // 1_000_000_000) & 0xFFFF_FFFF,
        )
        self._driver = self.drive(self._core, self._perform, settled=self._settled)
        self._board: BoardWriter[TimeFunctions] | None = None
        self._met = asyncio.Event()
        """Set when a neighbour has a clock that cannot be measured yet."""

    async def run(self) -> None:
        """Estimates, publishes and exchanges functions until cancelled."""
        module = self.module
        self._board = module.writer(
            "time/functions",
            TimeFunctions,
            link="request",
            log="all",
            description="Conversion functions of the clocks of all known hardware units",
        )
        module.serve(
            "sys/time/functions",
            Empty,
            self._on_request,
            reply=TimeFunctions,
            description="Current conversion functions",
        )
        timing = module.stream_reader("net/timing", TimingBatch)
        self._publish(self._core.functions(module.now_ns()))
        async with asyncio.TaskGroup() as group:
            group.create_task(self._driver.run(), name="time: driver")
            group.create_task(self._measure(timing), name="time: measure")
            routes = module.reader("net/routes", Routes)
            group.create_task(self._exchange(routes), name="time: exchange")

    async def _measure(self, timing: StreamReader[TimingBatch]) -> None:
        async for batch in timing:
            now_ns = self.module.now_ns()
            self._driver.feed(
                [
                    action
                    for sample in batch.samples
                    for action in self._core.on_exchange(_peer_exchange(sample), now_ns)
                ]
            )

    def _settled(self) -> None:
        if self._core.unmeasured():
            self._met.set()

    def _perform(self, action: Action) -> None:
        log = self.module.log
        match action:
            case Publish(functions):
                self._publish(functions)
            case ClockStepped(platform, unit, epoch):
                log.warning("%s.%s: remote or local clock has stepped, epoch %d", platform, unit, epoch)
            case UnitRebooted(platform, unit):
                log.info("%s.%s: rebooted, its clock has a new origin", platform, unit)
            case FunctionsRefused(platform, refused, of):
                log.warning(
                    "functions of %s: %d of %d refused; "
                    "expected finite numbers, a skew within ±0.001 per link",
                    platform,
                    refused,
                    of,
                )

    def _publish(self, functions: TimeFunctions) -> None:
        if self._board is not None:
            self._board.write(functions)

    async def _exchange(self, routes: BoardReader[Routes]) -> None:
        """Requests functions of neighbours that cannot be measured yet, and of those on routes to others."""
        pause_s = ASK_FIRST_S
        while True:
            self._met.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._met.wait(), pause_s)
            unmeasured = self._core.unmeasured()
            far = self._far(routes.value) if self.config.compose else {}
            for platform in sorted(unmeasured | self._core.stated() | set(far.values())):
                await self._ask(platform)
            functions = self._core.functions(self.module.now_ns())
            found = [functions.of(platform) for platform in far]
            young = any(one is None or one.samples < YOUNG_SAMPLES for one in found)
            pause_s = ASK_FIRST_S if young or not far or unmeasured else ASK_S
            if unmeasured & self._core.unmeasured():
                await asyncio.sleep(ASK_FIRST_S)  # they have no function either: `_met` is set again at once

    def _far(self, known: Routes | None) -> dict[str, str]:
        """Platforms out of direct range, each with the measured neighbour on the route to it."""
        measured = self._core.measured_since(self.module.now_ns() - MEASURED_DIRECTLY_NS)
        return {
            route.platform: route.via
            for route in (known.routes if known is not None else ())
            if route.hops > 1 and route.platform not in measured and route.via in measured
        }

    async def _ask(self, platform: str) -> None:
        try:
            received = await self.module.request(f"/{platform}/sys/time/functions", Empty(), TimeFunctions)
        except SwarmError as error:
            self.module.log.debug("functions of %s: %s", platform, error)
            return
        self._driver.feed(self._core.on_functions(received, self.module.now_ns()))

    def _on_request(self, _: Empty, __: Meta) -> TimeFunctions:
        return self._core.functions(self.module.now_ns())


def _peer_exchange(sample: TimingSample) -> PeerExchange:
    return PeerExchange(
        sample.platform,
        sample.unit,
        sample.hardware,
        sample.boot_id,
        Exchange(sample.received_ns, sample.lower_ns, sample.sent_ns, sample.upper_ns),
    )
