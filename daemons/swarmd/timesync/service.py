"""Shell of time synchronisation: reads clock differences from the broker's stream, publishes functions.

Direct neighbours cost no traffic, because the beacons carry the stamps (S1.72). For platforms out of direct
range the service requests the functions of the neighbours on the route to them.
"""

import asyncio

from swarmd.timesync import config as settings
from swarmd.timesync.core.exchange import Action as ExchangeAction
from swarmd.timesync.core.exchange import ExchangeCore, ReadRouteTable, RequestFunctions
from swarmd.timesync.core.peer import Exchange
from swarmd.timesync.core.time_core import (
    Action,
    ClockStepped,
    FunctionsRefused,
    PeerExchange,
    Publish,
    TimeCore,
    UnitRebooted,
)
from swarmd.timesync.core.wall_clock import WallClock, WallClockStep
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.model.clock import utc_ns
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.module.writer import BoardWriter
from swarmware.service.service import Service
from swarmware.types.health import OK_STATE
from swarmware.types.net import Routes
from swarmware.types.rpc import Empty
from swarmware.types.time import TimeFunctions, TimingBatch, TimingSample


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
            # grows with every restart, because other nodes may still hold functions of the previous run
            first_epoch=(node.clock.now_ns() // 1_000_000_000) & 0xFFFF_FFFF,
        )
        self._driver = self.drive(self._core, self._perform, settled=self._settled)
        self._exchange = ExchangeCore(self._core, config, node.clock.now_ns())
        self._exchange_driver = self.drive(self._exchange, self._perform_exchange)
        self._requests: asyncio.Queue[str] = asyncio.Queue()
        """Platforms whose functions are requested, one after the other."""
        self._routes = module.reader("net/routes", Routes)
        self._board: BoardWriter[TimeFunctions] | None = None
        self._wall_clock = WallClock()
        self._step_s = 0.0
        """Step of the wall clock at the last reading, so that each step is logged once."""
        self._look_at_wall_clock()
        self.health.register(
            "wall_clock",
            frequency_hz=1.0,
            data=self._look_at_wall_clock,
            criterion=lambda found: "stepped" if found.step_s else OK_STATE,
            levels={"stepped": "warn"},
            description="The wall clock of this computer was not stepped",
        )

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
            group.create_task(self._exchange_driver.run(), name="time: exchange")
            group.create_task(self._request_functions(), name="time: requests")

    def _look_at_wall_clock(self) -> WallClockStep:
        clock = self.module.clock
        before_ns, wall_ns = clock.now_ns(), utc_ns()
        found = self._wall_clock.on_look(before_ns, wall_ns, clock.now_ns())
        if found.step_s not in {0.0, self._step_s}:
            self.module.log.warning(
                "the wall clock stepped by %+.1f s: records have its new time; flight and time"
                " synchronisation do not use it",
                found.step_s,
            )
        self._step_s = found.step_s
        return found

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
            self._exchange_driver.feed()  # the deadline of the next round may be earlier now

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

    def _perform_exchange(self, action: ExchangeAction) -> None:
        match action:
            case ReadRouteTable():
                now_ns = self.module.now_ns()
                self._exchange_driver.feed(self._exchange.on_routes_read(self._routes.value, now_ns))
            case RequestFunctions(platform):
                self._requests.put_nowait(platform)

    async def _request_functions(self) -> None:
        while True:
            platform = await self._requests.get()
            try:
                received = await self.module.request(
                    names.join(names.Address.parse(platform).path, "sys/time/functions"),
                    Empty(),
                    TimeFunctions,
                )
            except SwarmError as error:
                self.module.log.debug("functions of %s: %s", platform, error)
            else:
                self._driver.feed(self._core.on_functions(received, self.module.now_ns()))
            self._exchange_driver.feed(self._exchange.on_request_ended(platform, self.module.now_ns()))

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
