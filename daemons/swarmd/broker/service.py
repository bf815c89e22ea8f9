"""The broker: joins its cores, its links and the node."""

import contextlib
import logging
import random
from typing import ClassVar, Final

import msgspec

from swarmd.broker import config as settings
from swarmd.broker.boards import Mirrors, OwnBoards
from swarmd.broker.core.mesh import LinkChanged, LinkEvent, LinkState, Mesh, RouteChanged
from swarmd.broker.core.pace import Pace
from swarmd.broker.core.relay import News
from swarmd.broker.core.sessions import Outcome, Sessions
from swarmd.broker.core.slowest import Slowest
from swarmd.broker.core.station import Arrival, Identity, Station
from swarmd.broker.core.tick import PlatformKind
from swarmd.broker.core.timing import Timing
from swarmd.broker.core.traffic import Counters
from swarmd.broker.datagrams import Datagrams
from swarmd.broker.former import Former
from swarmd.broker.frames import Frames
from swarmd.broker.links.udp import loopback_only
from swarmd.broker.report import Report
from swarmware.clock import utc_ns
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.module import Module
from swarmware.module.wakeup import Wakeup
from swarmware.names import Pattern
from swarmware.resource import Kind, Resource
from swarmware.runtime.instant import wait_s
from swarmware.security import Keys
from swarmware.service import Service
from swarmware.types.net import (
    ChannelLimits,
    Denial,
    Neighbours,
    Routes,
    SetChannel,
    TimingBatch,
    TimingSample,
    Traffic,
    TreePlan,
    Want,
)
from swarmware.types.rpc import Empty

DUPLICATE_NS: Final = 5_000_000_000
"""A second computer of the same name was not heard for so long: it has gone."""
PUBLISH_NS: Final = 1_000_000_000
TIMING_SLOTS: Final = 64
TIMING_SLOT_BYTES: Final = 4096
_SEQUENCE_NS: Final = 100_000_000
"""Sequence numbers start at the wall clock in ticks of 10 Hz: above those of a former session."""
PROMISED: Final = frozenset({Kind.STREAM, Kind.EVENT})
"""Kinds of which every item is promised: no limit leaves any out."""

log = logging.getLogger("swarm.broker")


class Broker(Service):
    """Links, neighbours, routes, channels and their counters."""

    name = "broker"
    Config: ClassVar = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        self._clock = module.clock
        self._wakeup = Wakeup()
        self._since_ns = self._publish_ns = self._clock.now_ns()
        self._pace = Pace(self._since_ns, random.random)
        self._shape_changed = False
        self._plan_at = -1
        self._timings: list[Timing] = []
        """Since our last tick."""
        self._duplicate_ns = 0
        self._counters = Counters()

    async def run(self) -> None:
        """Ticks until it is cancelled.

        Raises: ConfigError when it cannot listen, Denied when the keys do not fit.
        """
        module, node = self.module, self.module.node
        with contextlib.ExitStack() as stack:
            keys = self._keys()
            config = loopback_only(self.config) if keys.is_open else self.config
            former = Former(self.module.node.config.data_path)
            session = former.next_session(utc_ns())
            self._station = self._make_station(keys, session, former)
            self._own_session = session
            sessions = Sessions(node.hardware, session, connections=not keys.is_open)
            self._datagrams = Datagrams(
                config,
                keys,
                session,
                self._clock,
                self._station,
                self._counters,
                sessions,
                self._arrived,
                self._on_outcome,
                former.keep,
            )
            stack.callback(self._datagrams.close)
            self._frames = Frames(
                config,
                keys,
                self._clock,
                node.post,
                node.table,
                self._station,
                self._counters,
                sessions,
                self._denied,
            )
            stack.callback(self._frames.close)
            self._own = OwnBoards(node, self._station.bulletin, self._counters)
            stack.callback(self._own.close)
            self._mirrors = Mirrors(node)
            stack.callback(self._mirrors.close)
            self._station.tcp_port = self._frames.links.port
            self._report = Report(
                self._station, self._counters, self._frames.links, self._datagrams.by_unicast, self._since_ns
            )
            await self._open_boards()
            self.health.report("name", description="One computer for each name")
            self.health.report("processor", description="Ticks begin when they are due")
            node.post.set_gateway(self._frames.from_here, self._frames.links.together)
            stack.callback(node.post.set_gateway, None)
            if config.seeds:
                module.start(self._datagrams.look_up_seeds(), "seeds")
            log.info("listening: udp %d, tcp %d", self._datagrams.port, self._frames.links.port)
            while True:
                await self._step()

    def _keys(self) -> Keys:
        config = self.module.node.config
        folder = self.module.node.config_dir / config.keys_dir  # an absolute one stays what it is
        if (folder / "node.key").exists():
            return Keys.load(folder, config.platform)
        log.warning(
            "no keys in %s: only this computer is served, and whoever is on it; "
            "make keys before the node talks to others",
            folder,
        )
        return Keys.open(config.platform)

    def _make_station(self, keys: Keys, session: int, former: Former) -> Station:
        node = self.module.node
        now_ns = self._clock.now_ns()
        timeout_ns = round(self.config.link_timeout_s * 1e9)
        station = Station(
            Identity(
                node.hardware,
                node.platform,
                node.config.unit,
                PlatformKind[node.config.kind.upper()],
                self._clock.boot_id,
                keys.curve_public if keys.is_open else b"",
            ),
            Mesh(
                node.hardware,
                session // _SEQUENCE_NS & 0x7FFF_FFFF,
                timeout_ns,
                now_ns + former.quiet_ns(timeout_ns),
            ),
            self._counters,
            busy_hz=self.config.tick_hz,
            relay_bytes_s=self.config.relay_bytes_s,
            slowest=Slowest(former.slowest_ns, now_ns),
        )
        if keys.roster is not None:
            for member in keys.roster.members:
                station.members.know(member.platform, now_ns)
        return station

    async def _open_boards(self) -> None:
        module = self.module
        self._plan = await module.reader("tree/plan", TreePlan)
        self._neighbours_board = await module.writer(
            "net/neighbours", Neighbours, rate_hz=1, link="request", description="Nodes heard directly"
        )
        self._routes_board = await module.writer(
            "net/routes", Routes, rate_hz=1, link="request", description="Nodes that can be reached"
        )
        self._traffic_board = await module.writer(
            "net/traffic", Traffic, rate_hz=1, link="request", log="1hz", description="Counters in bytes"
        )
        self._limits_board = await module.writer(
            "net/limits", ChannelLimits, link="request", description="Limits of rates in force"
        )
        self._limits_board.write(ChannelLimits())
        self._denials = await module.stream_writer(
            "net/denials", Denial, kind="event", log="all", description="Who asked for what it may not"
        )
        self._timing_stream = await module.stream_writer(
            "net/timing",
            TimingBatch,
            slots=TIMING_SLOTS,
            slot_bytes=TIMING_SLOT_BYTES,
            description="Clock differences read off datagrams",
        )
        await module.serve("sys/broker/links", Empty, self._serve_links, reply=Neighbours)
        await module.serve("sys/broker/traffic", Empty, self._serve_traffic, reply=Traffic)
        await module.serve("sys/broker/routes", Empty, self._serve_routes, reply=Routes)
        await module.serve("sys/broker/set_channel", SetChannel, self._serve_set, reply=ChannelLimits)

    # time

    async def _step(self) -> None:
        self._datagrams.receive()  # before deadlines are judged
        now_ns = self._clock.now_ns()
        version = self._station.channels.version
        self._carry_out(*self._station.on_timer(now_ns))
        if self._station.channels.version != version:
            self._limits_board.write(self._station.channels.limits(now_ns))
        if now_ns >= self._pace.due_ns:
            self._tick()
        if now_ns >= self._publish_ns or self._shape_changed:
            self._publish(now_ns)
        next_ns = min(self._pace.due_ns, self._publish_ns)
        deadline_ns = self._station.deadline_ns()
        if deadline_ns is not None:
            next_ns = min(next_ns, deadline_ns)
        await self._wakeup.wait(wait_s(self._clock, next_ns))

    def _tick(self) -> None:
        station = self._station
        if self._plan.position != self._plan_at:
            self._take_plan()
        now_ns = self._clock.now_ns()
        if station.slowdown.on_tick(now_ns - self._pace.due_ns, round(1e9 / station.tick_hz())):
            self._report_slowdown()
        self._own.poll(now_ns)
        if self._timings:
            self._write_timings()
        pace, period_ns = self._pace, round(1e9 / station.tick_hz())
        urgent = pace.urgent or self._datagrams.has_checks
        if not urgent and station.is_idle(now_ns + pace.spread_ns(period_ns)):
            pace.rest(now_ns, period_ns)
        elif urgent or not pace.rises(now_ns, period_ns):
            pace.left(now_ns)
            self._datagrams.tick(now_ns)
            pace.next(now_ns, round(1e9 / station.tick_hz()))

    def _report_slowdown(self) -> None:
        slowdown = self._station.slowdown
        if slowdown.factor == 1:
            self.health.report("processor")
            return
        self.health.report(
            "processor",
            "short",
            level="warn",
            detail=f"ticks slowed {slowdown.factor:.1f} times: half of them began"
            f" {slowdown.late_ns / 1e6:.0f} ms late; run fewer services or nodes on this computer",
            description="Ticks begin when they are due",
            clear_s=5.0,
        )

    def _write_timings(self) -> None:
        find = self._station.members.get
        samples = [
            TimingSample(
                member.platform,
                member.unit,
                timing.hw,
                timing.boot_id,
                timing.rx_ns,
                timing.reverse_ns,
                timing.forward_tx_ns,
                timing.forward_ns,
            )
            for timing in self._timings
            if (member := find(timing.hw)) is not None
        ]
        self._timings.clear()
        if samples:
            self._timing_stream.write(TimingBatch(tuple(samples)))

    def _take_plan(self) -> None:
        self._plan_at = self._plan.position
        plan = self._plan.value
        if plan is not None:
            self._mirrors.keep_only(plan.wants)
            self._mirror(self._station.set_plan(plan))

    def _publish(self, now_ns: int) -> None:
        if now_ns >= self._publish_ns:
            self._publish_ns = (now_ns // PUBLISH_NS + 1) * PUBLISH_NS
            self._traffic_board.write(self._report.traffic(now_ns))
        if self._duplicate_ns and now_ns - self._duplicate_ns > DUPLICATE_NS:
            self._duplicate_ns = 0
            self.health.report("name")
        self._shape_changed = False
        self._neighbours_board.write(self._report.neighbours(now_ns))
        self._routes_board.write(self._report.routes())

    def _denied(self, denial: Denial) -> None:
        self._denials.write(denial)

    # what a datagram changed

    def _arrived(self, arrival: Arrival) -> None:
        if arrival.timing is not None:
            self._timings.append(arrival.timing)
        if arrival.news:
            self._mirror(arrival.news)
        if arrival.stranger:
            self._station.say_hello()
        if arrival.links or arrival.routes:
            self._carry_out(arrival.links, arrival.routes)
        if arrival.stranger or arrival.links:
            self._hurry()

    def _on_outcome(self, hw: int, outcome: Outcome) -> None:
        """A datagram asked for an answer, or was of a session that is not believed."""
        if outcome.prove:
            self._frames.prove(hw, self._own_session)
        if outcome.duplicate:
            self._report_duplicate(hw)
        if outcome.soon:
            self._station.say_hello()
            self._hurry()

    def _report_duplicate(self, hw: int) -> None:
        name = self._station.members.platform(hw)
        own = hw == self.module.node.hardware
        if not self._duplicate_ns:
            log.error(
                "two computers are named %s: %s; change the platform in node.toml of one of them",
                name,
                "this one and another" if own else "both are heard here",
            )
        self._duplicate_ns = self._clock.now_ns()
        self.health.report(
            "name",
            "duplicate",
            level="error" if own else "warn",
            detail=f"two computers are named {name}",
            description="One computer for each name",
            clear_s=5.0,
        )

    def _mirror(self, found: list[tuple[Want, News]]) -> None:
        for want, news in found:
            if self._mirrors.write(want, news):
                self._counters.notifications += 1

    def _hurry(self) -> None:
        if self._pace.hurry(self._clock.now_ns(), round(1e9 / self._station.allowed_hz())):
            self._wakeup.notify()

    def _carry_out(self, links: list[LinkChanged], routes: list[RouteChanged]) -> None:
        for change in links:
            name = self._station.members.platform(change.hw)
            if change.after is LinkState.UP:
                log.info("neighbour %s: up", name)
            elif change.before is LinkState.UP:
                log.info("neighbour %s: %s (%s)", name, change.after.name.lower(), change.event.name.lower())
                self._frames.neighbour_gone(change.hw)
        if links or routes:
            self._shape_changed = True
            self._wakeup.notify()
        if any(not change.via for change in routes) or any(c.event is LinkEvent.SILENT for c in links):
            self._hurry()  # others should know soon

    # requests

    def _serve_links(self, _request: Empty, _meta: object) -> Neighbours:
        return self._report.neighbours(self._clock.now_ns())

    def _serve_routes(self, _request: Empty, _meta: object) -> Routes:
        return self._report.routes()

    def _serve_traffic(self, _request: Empty, _meta: object) -> Traffic:
        return self._report.traffic(self._clock.now_ns())

    def _serve_set(self, request: SetChannel, _meta: object) -> ChannelLimits:
        if request.max_hz is not None and not 0 <= request.max_hz <= 1000:
            raise OutOfRange(f"max_hz {request.max_hz}: expected 0..1000, or none to take the limit away")
        if not 0 <= request.for_s <= 86_400:
            raise OutOfRange(f"for_s {request.for_s}: expected 0..86400 seconds")
        matching = self._matching(request.pattern)
        unlimited = [resource.path for resource in matching if resource.kind in PROMISED]
        if request.max_hz is not None and unlimited and len(unlimited) == len(matching):
            raise InvalidInput(
                f"pattern {request.pattern!r}: matches only {', '.join(unlimited[:3])}, of which each item is"
                " promised; expected boards: the rate of a stream is its owner's to set"
            )
        now_ns = self._clock.now_ns()
        self._station.channels.set(request, now_ns)
        limits = self._station.channels.limits(now_ns)
        self._limits_board.write(limits)
        return msgspec.structs.replace(limits, unlimited=tuple(unlimited))

    def _matching(self, text: str) -> list[Resource]:
        """Resources of the applications here whose path matches."""
        pattern = Pattern(text)
        table = self.module.node.table
        table.refresh()
        return [each for entry in table for each in entry.provides if pattern.matches(each.path)]
