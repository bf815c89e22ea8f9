"""The broker service: connects its cores with sockets, shared memory and the node."""

import contextlib
import logging
import random
from typing import ClassVar, Final

import msgspec

from swarmd.broker import config as settings
from swarmd.broker.beacon_transport import BeaconTransport
from swarmd.broker.core.beacon import PlatformKind
from swarmd.broker.core.beacon_protocol import BeaconProtocol, NodeIdentity, ReceivedBeacon
from swarmd.broker.core.beacon_rate import BeaconSchedule
from swarmd.broker.core.clock_sample import ClockSample
from swarmd.broker.core.declared_period import DeclaredPeriod
from swarmd.broker.core.relay_cache import RemoteValue
from swarmd.broker.core.sessions import SessionOutcome, Sessions
from swarmd.broker.core.topology import LinkChanged, LinkEvent, LinkState, RouteChanged, Topology
from swarmd.broker.core.traffic import Counters
from swarmd.broker.former_session import FormerSession
from swarmd.broker.frame_gateway import FrameGateway
from swarmd.broker.links.udp import loopback_only
from swarmd.broker.mirrored_boards import MirroredBoards
from swarmd.broker.own_boards import OwnBoards
from swarmd.broker.report import NetReport
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.model.clock import utc_ns
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.module.wakeup import Wakeup
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.runtime.instant import wait_s
from swarmware.service.service import Service
from swarmware.transport.security import Keys
from swarmware.types.net import (
    BoardSubscription,
    ChannelLimits,
    Denial,
    Neighbours,
    Routes,
    SetChannel,
    TimingBatch,
    TimingSample,
    Traffic,
    TreePlan,
)
from swarmware.types.rpc import Empty

DUPLICATE_NS: Final = 5_000_000_000
"""A duplicate of a platform name is cleared after this time without a datagram of the second computer."""
PUBLISH_NS: Final = 1_000_000_000
TIMING_SLOTS: Final = 64
TIMING_SLOT_BYTES: Final = 4096
_SEQUENCE_NS: Final = 100_000_000
"""Sequence numbers start at the wall clock in beacons of 10 Hz: above those of a former session."""
PROMISED: Final = frozenset({Kind.STREAM, Kind.EVENT})
"""Kinds with guaranteed delivery of every item: rate limits do not apply to them."""

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
        self._schedule = BeaconSchedule(self._since_ns, random.random)
        self._topology_changed = False
        self._plan_at = -1
        self._clock_samples: list[ClockSample] = []
        """Samples since the last own beacon."""
        self._duplicate_ns = 0
        self._counters = Counters()

    async def run(self) -> None:
        """Sends beacons and forwards frames until it is cancelled.

        Raises: ConfigError when it cannot listen, Denied when the keys do not fit.
        """
        module, node = self.module, self.module.node
        with contextlib.ExitStack() as stack:
            keys = self._keys()
            config = loopback_only(self.config) if keys.is_open else self.config
            former_session = FormerSession(self.module.node.config.data_path)
            session = former_session.next_session(utc_ns())
            self._protocol = self._make_protocol(keys, session, former_session)
            self._own_session = session
            sessions = Sessions(node.hardware, session, connections=not keys.is_open)
            self._transport = BeaconTransport(
                config,
                keys,
                session,
                self._clock,
                self._protocol,
                self._counters,
                sessions,
                self._on_received,
                self._on_outcome,
                former_session.keep,
            )
            stack.callback(self._transport.close)
            self._gateway = FrameGateway(
                config,
                keys,
                self._clock,
                node.post,
                node.table,
                self._protocol,
                self._counters,
                sessions,
                self._denied,
            )
            stack.callback(self._gateway.close)
            self._own = OwnBoards(node, self._protocol.published, self._counters)
            stack.callback(self._own.close)
            self._mirrors = MirroredBoards(MirrorWriter(node), self._counters)
            stack.callback(self._mirrors.close)
            self._protocol.tcp_port = self._gateway.links.port
            self._report = NetReport(
                self._protocol,
                self._counters,
                self._gateway.links,
                self._transport.by_unicast,
                self._since_ns,
            )
            self._open_boards()
            self.health.report("name", description="One computer for each name")
            self.health.report("processor", description="Beacons begin when they are due")
            node.post.set_gateway(self._gateway.from_here, self._gateway.links.batch)
            stack.callback(node.post.set_gateway, None)
            if config.seeds:
                module.start(self._transport.look_up_seeds(), "seeds")
            log.info("listening: udp %d, tcp %d", self._transport.port, self._gateway.links.port)
            while True:
                await self._step()

    def _keys(self) -> Keys:
        config = self.module.node.config
        folder = self.module.node.config_dir / config.keys_dir  # an absolute one stays what it is
        if (folder / "node.key").exists():
            return Keys.load(folder, config.platform)
        log.warning(
            "no keys in %s: only this computer is served, without authentication; "
            "make keys before the node communicates with other computers",
            folder,
        )
        return Keys.open(config.platform)

    def _make_protocol(self, keys: Keys, session: int, former_session: FormerSession) -> BeaconProtocol:
        node = self.module.node
        now_ns = self._clock.now_ns()
        timeout_ns = round(self.config.link_timeout_s * 1e9)
        protocol = BeaconProtocol(
            NodeIdentity(
                node.hardware,
                node.platform,
                node.config.unit,
                PlatformKind[node.config.kind.upper()],
                self._clock.boot_id,
                keys.curve_public if keys.is_open else b"",
            ),
            Topology(
                node.hardware,
                session // _SEQUENCE_NS & 0x7FFF_FFFF,
                timeout_ns,
                now_ns + former_session.quiet_ns(timeout_ns),
            ),
            self._counters,
            busy_hz=self.config.tick_hz,
            relay_bytes_s=self.config.relay_bytes_s,
            declared_period=DeclaredPeriod(former_session.declared_period_ns, now_ns),
        )
        if keys.roster is not None:
            for member in keys.roster.members:
                protocol.nodes.add(member.platform, now_ns)
        return protocol

    def _open_boards(self) -> None:
        module = self.module
        self._plan = module.reader("tree/plan", TreePlan)
        self._neighbours_board = module.writer(
            "net/neighbours", Neighbours, rate_hz=1, link="request", description="Nodes received directly"
        )
        self._routes_board = module.writer(
            "net/routes", Routes, rate_hz=1, link="request", description="Nodes that can be reached"
        )
        self._traffic_board = module.writer(
            "net/traffic",
            Traffic,
            rate_hz=1,
            link="request",
            log="1hz",
            description="Traffic counters in bytes",
        )
        self._limits_board = module.writer(
            "net/limits", ChannelLimits, link="request", description="Limits of rates in force"
        )
        self._limits_board.write(ChannelLimits())
        self._denials = module.stream_writer(
            "net/denials", Denial, kind="event", log="all", description="Requests denied by access control"
        )
        self._timing_stream = module.stream_writer(
            "net/timing",
            TimingBatch,
            slots=TIMING_SLOTS,
            slot_bytes=TIMING_SLOT_BYTES,
            description="Clock differences measured from datagrams",
        )
        module.serve("sys/broker/links", Empty, self._serve_links, reply=Neighbours)
        module.serve("sys/broker/traffic", Empty, self._serve_traffic, reply=Traffic)
        module.serve("sys/broker/routes", Empty, self._serve_routes, reply=Routes)
        module.serve("sys/broker/set_channel", SetChannel, self._serve_set, reply=ChannelLimits)

    # time

    async def _step(self) -> None:
        self._transport.receive()  # before deadlines are judged
        now_ns = self._clock.now_ns()
        version = self._protocol.rate_limits.version
        self._carry_out(*self._protocol.on_timer(now_ns))
        if self._protocol.rate_limits.version != version:
            self._limits_board.write(self._protocol.rate_limits.limits(now_ns))
        if now_ns >= self._schedule.due_ns:
            self._on_beacon_due()
        if now_ns >= self._publish_ns or self._topology_changed:
            self._publish(now_ns)
        next_ns = min(self._schedule.due_ns, self._publish_ns)
        deadline_ns = self._protocol.deadline_ns()
        if deadline_ns is not None:
            next_ns = min(next_ns, deadline_ns)
        await self._wakeup.wait(wait_s(self._clock, next_ns))

    def _on_beacon_due(self) -> None:
        protocol = self._protocol
        if self._plan.position != self._plan_at:
            self._take_plan()
        now_ns = self._clock.now_ns()
        if protocol.slowdown.on_beacon(now_ns - self._schedule.due_ns, round(1e9 / protocol.beacon_hz())):
            self._report_slowdown()
        self._own.poll(now_ns)
        if self._clock_samples:
            self._write_clock_samples()
        schedule, period_ns = self._schedule, round(1e9 / protocol.beacon_hz())
        urgent = schedule.urgent or self._transport.has_checks
        if not urgent and protocol.may_skip(now_ns + schedule.jitter_ns(period_ns)):
            schedule.skip(now_ns, period_ns)
        elif urgent or not schedule.defer_after_skip(now_ns, period_ns):
            schedule.on_sent(now_ns)
            self._transport.send_beacon(now_ns)
            schedule.set_next(now_ns, round(1e9 / protocol.beacon_hz()))

    def _report_slowdown(self) -> None:
        slowdown = self._protocol.slowdown
        if slowdown.factor == 1:
            self.health.report("processor")
            return
        self.health.report(
            "processor",
            "short",
            level="warn",
            detail=f"beacons slowed {slowdown.factor:.1f} times: half of them began"
            f" {slowdown.late_ns / 1e6:.0f} ms late; run fewer services or nodes on this computer",
            description="Beacons begin when they are due",
            clear_s=5.0,
        )

    def _write_clock_samples(self) -> None:
        find = self._protocol.nodes.get
        samples = [
            TimingSample(
                member.platform,
                member.unit,
                clock_sample.hw,
                clock_sample.boot_id,
                clock_sample.rx_ns,
                clock_sample.reverse_ns,
                clock_sample.forward_tx_ns,
                clock_sample.forward_ns,
            )
            for clock_sample in self._clock_samples
            if (member := find(clock_sample.hw)) is not None
        ]
        self._clock_samples.clear()
        if samples:
            self._timing_stream.write(TimingBatch(tuple(samples)))

    def _take_plan(self) -> None:
        self._plan_at = self._plan.position
        plan = self._plan.value
        if plan is not None:
            self._mirrors.keep_only(plan.wants)
            self._mirror(self._protocol.set_plan(plan))

    def _publish(self, now_ns: int) -> None:
        if now_ns >= self._publish_ns:
            self._publish_ns = (now_ns // PUBLISH_NS + 1) * PUBLISH_NS
            self._traffic_board.write(self._report.traffic(now_ns))
        if self._duplicate_ns and now_ns - self._duplicate_ns > DUPLICATE_NS:
            self._duplicate_ns = 0
            self.health.report("name")
        self._topology_changed = False
        self._neighbours_board.write(self._report.neighbours(now_ns))
        self._routes_board.write(self._report.routes())

    def _denied(self, denial: Denial) -> None:
        self._denials.write(denial)

    # results of datagrams

    def _on_received(self, received: ReceivedBeacon) -> None:
        if received.clock_sample is not None:
            self._clock_samples.append(received.clock_sample)
        if received.values:
            self._mirror(received.values)
        if received.first_hello:
            self._protocol.schedule_hello()
        if received.links or received.routes:
            self._carry_out(received.links, received.routes)
        if received.first_hello or received.links:
            self._trigger_beacon()

    def _on_outcome(self, hw: int, outcome: SessionOutcome) -> None:
        """Reacts to a datagram that needs an answer, or whose session is not accepted yet."""
        if outcome.prove:
            self._gateway.prove(hw, self._own_session)
        if outcome.duplicate:
            self._report_duplicate(hw)
        if outcome.soon:
            self._protocol.schedule_hello()
            self._trigger_beacon()

    def _report_duplicate(self, hw: int) -> None:
        name = self._protocol.nodes.platform(hw)
        own = hw == self.module.node.hardware
        if not self._duplicate_ns:
            log.error(
                "two computers are named %s: %s; change the platform in node.toml of one of them",
                name,
                "this one and another" if own else "both are received here",
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

    def _mirror(self, found: list[tuple[BoardSubscription, RemoteValue]]) -> None:
        for want, value in found:
            if self._mirrors.write(want, value):
                self._counters.notifications += 1

    def _trigger_beacon(self) -> None:
        if self._schedule.trigger(self._clock.now_ns(), round(1e9 / self._protocol.allowed_hz())):
            self._wakeup.notify()

    def _carry_out(self, links: list[LinkChanged], routes: list[RouteChanged]) -> None:
        for change in links:
            name = self._protocol.nodes.platform(change.hw)
            if change.after is LinkState.UP:
                log.info("neighbour %s: up", name)
            elif change.before is LinkState.UP:
                log.info("neighbour %s: %s (%s)", name, change.after.name.lower(), change.event.name.lower())
                self._gateway.neighbour_gone(change.hw)
        if links or routes:
            self._topology_changed = True
            self._wakeup.notify()
        if any(not change.via for change in routes) or any(c.event is LinkEvent.SILENT for c in links):
            self._trigger_beacon()  # so that other nodes learn of it soon

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
                " promised; expected boards: the owner of a stream sets its rate"
            )
        now_ns = self._clock.now_ns()
        self._protocol.rate_limits.set(request, now_ns)
        limits = self._protocol.rate_limits.limits(now_ns)
        self._limits_board.write(limits)
        return msgspec.structs.replace(limits, unlimited=tuple(unlimited))

    def _matching(self, text: str) -> list[Resource]:
        """Resources of local applications whose path matches."""
        pattern = Pattern(text)
        table = self.module.node.table
        table.refresh()
        return [each for entry in table for each in entry.provides if pattern.matches(each.path)]
