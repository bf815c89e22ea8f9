"""The broker service: its keys, its session and its core, with sockets, boards and the router around it."""

import asyncio
import contextlib
import logging
import random
from typing import TYPE_CHECKING, ClassVar, Final

import msgspec

from swarmd.broker import config as settings
from swarmd.broker.boards.channel_api import ChannelApi
from swarmd.broker.boards.net_boards import NetBoards
from swarmd.broker.boards.shared_boards import MirroredBoards, OwnBoards
from swarmd.broker.core.beacon.beacon import PlatformCode
from swarmd.broker.core.beacon.beacon_rate import ReportSlowdown
from swarmd.broker.core.beacon.declared_period import RestartState
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.boards.board_action import (
    KeepMirrors,
    LimitEnded,
    ReportUnsignedValues,
    WriteMirrors,
    WriteStructure,
)
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.broker import Action, BrokerCore
from swarmd.broker.core.membership.roster.roster_exchange import ApplyRoster, RosterExchange, SendRoster
from swarmd.broker.core.membership.sessions import (
    AdoptSession,
    ProveSession,
    ReportDuplicate,
    ReportDuplicateGone,
    ReportImpersonation,
    SwarmMembership,
)
from swarmd.broker.core.reports.report import PublishTables, RefusalLog
from swarmd.broker.core.swarm.clock_batches import WriteClockSamples
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkState
from swarmd.broker.core.swarm.media.medium import MediumProfile
from swarmd.broker.core.swarm.neighbours.medium_table import MediumChanged
from swarmd.broker.exchange.beacon_transport import FAULTS, BeaconTransport
from swarmd.broker.exchange.frame_gateway import FrameGateway
from swarmd.broker.records.conditions import Conditions
from swarmd.broker.records.forgery_reports import ForgeryReports
from swarmd.broker.records.membership import Membership, keys_folder
from swarmd.broker.records.outage_recorder import OutageRecorder
from swarmd.broker.records.session_store import SessionStore
from swarmd.broker.sockets.media import Media, MediaLinks
from swarmd.broker.sockets.medium import MediumDatagram
from swarmd.broker.sockets.pinned_addresses import PinnedAddresses
from swarmd.broker.sockets.udp import loopback_only
from swarmware.model.clock import utc_ns
from swarmware.model.names import Address
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.service.channels import load_channels
from swarmware.service.service import Service
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys
from swarmware.types.net import Denial, Neighbours, RosterState, Routes, SignedRoster, TreePlan
from swarmware.types.outage import OutageTable
from swarmware.types.rpc import Empty
from swarmware.types.traffic import Refused, Traffic

if TYPE_CHECKING:
    from swarmd.broker.records.metrics_server import MetricsServer

OF_DATAGRAMS: Final = (
    AdoptSession,
    LinkChanged,
    ProveSession,
    WriteMirrors,
    WriteStructure,
)
"""Actions that a received datagram causes: an exception in one of them ends this action, never the broker."""

log = logging.getLogger("swarm.broker")


class BrokerShell:
    """Feeds the broker's core and carries out its actions."""

    def __init__(
        self,
        service: Service,
        config: settings.Config,
        keys: Keys,
        core: BrokerCore,
        session_store: SessionStore,
    ) -> None:
        """Raises: ConfigError when an address or port cannot be used, or the access rules are invalid."""
        module, node = service.module, service.module.node
        node.access_rules.check()
        self._conditions = Conditions(service.health, node.access_rules, PinnedAddresses(config))
        self._module = module
        self._clock = module.clock
        self._core = core
        self._plan_at = -1
        self._refusals = RefusalLog()
        self._denials = DenialReporter(self._on_denial)
        self._forgeries = ForgeryReports(core, keys, self._denials)
        self._seeds = bool(config.seeds)
        self._driver = service.drive(self, self._perform, settled=self._send_due_beacon)
        feed = self._driver.feed
        with contextlib.ExitStack() as stack:
            stack.callback(self._denials.close)
            # closed in the reverse order, so each part before the parts that it uses
            self._media = Media(
                config,
                asyncio.get_running_loop(),
                module.clock,
                core.counters.refused,
                on_beacon=self._on_beacon,
                on_frame=self._on_frame,
                on_line=self._conditions.on_line,
            )
            stack.callback(self._media.close)
            self._transport = BeaconTransport(
                config, keys, self._media, module.clock, core, feed, session_store.keep
            )
            self._gateway = FrameGateway(
                config,
                keys,
                node,
                core,
                None if core.media is None else MediaLinks(self._media, core.media, module.clock),
                self._denials,
                lambda found: feed(core.on_roster_actions(found, module.clock.now_ns())),
            )
            stack.callback(self._gateway.close)
            self._own = OwnBoards(node, core.published, core.counters)
            stack.callback(self._own.close)
            self._mirrors = MirroredBoards(MirrorWriter(node), core.counters)
            stack.callback(self._mirrors.close)
            self._boards = NetBoards(module)
            self._outages = OutageRecorder(
                config,
                node.config.data_path,
                self._boards.outages,
                module.clock,
                core,
                self._gateway.links.waiting,
            )
            stack.callback(self._outages.close)
            self._metrics: MetricsServer | None = None
            if config.metrics_port:
                from swarmd.broker.records import metrics_server  # with an HTTP library

                self._metrics = metrics_server.MetricsServer(
                    config, self._metrics_page, core.counters.refused
                )
                stack.callback(self._metrics.close)
            self._closing = stack.pop_all()
        self._channel_api = ChannelApi(module, core.channels, self._boards.limits)
        self._membership = Membership(service, keys, self._transport, self._gateway)
        self._plan = module.reader("tree/plan", TreePlan)
        # known only now; with port 0 the kernel has chosen them
        links = self._gateway.links
        core.set_ports(links.tcp_port, links.frame_port)

    async def run(self) -> None:
        """Serves the requests and drives the core until it is cancelled."""
        module, messaging = self._module, self._module.node.messaging
        module.serve("sys/broker/links", Empty, self._serve_links, reply=Neighbours)
        module.serve("sys/broker/traffic", Empty, self._serve_traffic, reply=Traffic)
        module.serve("sys/broker/outages", Empty, self._serve_outages, reply=OutageTable)
        module.serve("sys/broker/routes", Empty, self._serve_routes, reply=Routes)
        module.serve("sys/broker/roster", SignedRoster, self._membership.serve, reply=RosterState)
        self._channel_api.serve()
        self._conditions.begin()
        if self._seeds:
            module.start(self._transport.look_up_seeds(), "seeds")
        if self._metrics is not None:
            module.start(self._metrics.run(), "metrics")
        gateway = self._gateway
        log.info("listening: udp %d, tcp %d", self._transport.port, gateway.links.tcp_port)
        messaging.set_gateway(gateway.from_here, gateway.batch, relay=gateway.from_here)
        try:
            await self._driver.run()
        finally:
            messaging.set_gateway(None)

    def close(self) -> None:
        """Closes the sockets; mirrors stay readable."""
        self._driver.stop()
        self._closing.close()

    # time

    def deadline_ns(self) -> int | None:
        """Instant of the core's next deadline."""
        return self._core.deadline_ns()

    def on_timer(self, now_ns: int) -> list[Action]:
        """Receives the waiting datagrams, reads the boards that a due beacon needs, then calls the core."""
        # boards are read only where a beacon is due; reading them costs more than a step of the core
        needs_boards = self._core.begin_turn(now_ns)
        # datagrams that wait may show that a link is not silent
        self._transport.receive()
        read_ns = self._clock.now_ns()
        actions: list[Action] = []
        if needs_boards:
            if self._plan.position != self._plan_at:
                self._plan_at = self._plan.position
                if (plan := self._plan.value) is not None:
                    actions += self._core.on_plan(plan, read_ns)
            self._own.poll(read_ns)
        return actions + self._core.on_timer(read_ns)

    def _send_due_beacon(self) -> None:
        if self._core.beacon_due:
            self._transport.send_beacon(self._clock.now_ns())

    # actions

    def _perform(self, action: Action) -> None:
        try:
            self._carry_out(action)
        except FAULTS:
            if not isinstance(action, OF_DATAGRAMS):
                raise
            self._core.counters.refused.failed += 1
            self._transport.log_fault("a datagram could not be processed")

    def _carry_out(self, action: Action) -> None:
        match action:
            case WriteMirrors():
                for want, value in action.values:
                    if self._mirrors.write(want, value):
                        self._core.counters.notifications += 1
            case WriteStructure():
                self._boards.structures.write(action.structure)
            case WriteClockSamples():
                self._boards.timing.write(action.batch)
            case PublishTables():
                self._publish(action.traffic)
            case LinkChanged():
                self._on_link_changed(action)
            case MediumChanged():
                self._gateway.links.on_medium(action.hw)
            case KeepMirrors():
                self._mirrors.keep_only(action.wants)
            case AdoptSession():
                self._transport.adopt(action.hw, action.session)
            case ProveSession():
                self._gateway.prove(action.hw, action.session)
            case LimitEnded():
                self._channel_api.on_time_over()
            case ReportDuplicate():
                self._conditions.on_duplicate(action)
            case ReportDuplicateGone():
                self._conditions.on_duplicate_gone()
            case SendRoster():
                self._gateway.send_roster(action)
            case ApplyRoster():
                self._membership.apply(action.change)
            case ReportSlowdown():
                self._conditions.on_slowdown(action)
            case ReportUnsignedValues():
                self._forgeries.on_values(action.found, self._clock.now_ns())
            case ReportImpersonation():
                self._forgeries.on_impersonation(action, self._clock.now_ns())

    def _publish(self, traffic: bool) -> None:
        self._gateway.on_routes()
        self._gateway.end_visits()
        self._conditions.check()
        if traffic:
            present = self._traffic()
            self._boards.traffic.write(present)
            self._log_refusals(present.refused)
        report, now_ns = self._core.report, self._clock.now_ns()
        self._gateway.links.on_qualities(report.link_qualities(now_ns))
        self._boards.neighbours.write(self._neighbours())
        self._boards.links.write(report.links(self._gateway.links.waiting, self._outages.lost, now_ns))
        self._boards.routes.write(self._core.report.routes())

    def _on_link_changed(self, change: LinkChanged) -> None:
        self._outages.on_link(change)
        name = self._core.nodes.platform(change.hw)
        if change.after is LinkState.UP:
            log.info("neighbour %s: up", name)
            self._gateway.prepare(change.hw)
        elif change.before is LinkState.UP:
            log.info("neighbour %s: %s (%s)", name, change.after.name.lower(), change.event.name.lower())
            self._gateway.neighbour_gone(change.hw)

    def _on_beacon(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        self._transport.on_datagram(medium, arrival)

    def _on_frame(self, medium: MediumProfile, arrival: MediumDatagram) -> None:
        self._gateway.links.on_datagram(medium, arrival)

    def _on_denial(self, denial: Denial) -> None:
        log.warning("denied: %s", denial.reason)
        self._boards.denials.write(denial)

    # requests

    def _neighbours(self) -> Neighbours:
        return self._core.report.neighbours(self._gateway.links.state, self._clock.now_ns())

    def _traffic(self) -> Traffic:
        self._gateway.update_counters()
        return self._core.report.traffic(self._clock.now_ns())

    def _metrics_page(self) -> str:
        from swarmd.broker.core.reports.metrics_page import metrics_page

        node = str(Address(self._module.platform, self._module.node.config.unit))
        return metrics_page(node, self._traffic(), self._neighbours(), self._outages.table())

    def _log_refusals(self, refused: Refused) -> None:
        line = self._refusals.on_counters(refused, self._clock.now_ns())
        if line is not None:
            log.log(logging.WARNING if line.is_warning else logging.INFO, "%s", line.text)

    def _serve_links(self, _request: Empty, _meta: object) -> Neighbours:
        return self._neighbours()

    def _serve_outages(self, _request: Empty, _meta: object) -> OutageTable:
        return self._outages.table()

    def _serve_routes(self, _request: Empty, _meta: object) -> Routes:
        return self._core.report.routes()

    def _serve_traffic(self, _request: Empty, _meta: object) -> Traffic:
        return self._traffic()


class Broker(Service):
    """Links, neighbours, routes, channels and their counters."""

    name = "broker"
    Config: ClassVar[type[msgspec.Struct]] = settings.Config
    config: settings.Config

    async def run(self) -> None:
        """Sends beacons and forwards frames until it is cancelled.

        Raises: ConfigError when it cannot listen, Denied when the keys do not match the roster.
        """
        module = self.module
        keys = self._keys()
        session_store = SessionStore(module.node.config.data_path)
        config = loopback_only(self.config) if keys.is_open else self.config
        core = self._core(config, keys, session_store)
        shell = BrokerShell(self, config, keys, core, session_store)
        with contextlib.closing(shell):
            await shell.run()

    def _keys(self) -> Keys:
        config, folder = self.module.node.config, keys_folder(self.module.node)
        if (folder / "node.key").exists():
            return Keys.load(folder, config.platform)
        log.warning(
            "no keys in %s: only this computer is served, without authentication; "
            "make keys before the node communicates with other computers",
            folder,
        )
        return Keys.open(config.platform)

    def _core(self, config: settings.Config, keys: Keys, session_store: SessionStore) -> BrokerCore:
        node, now_ns = self.module.node, self.module.clock.now_ns()
        session = session_store.next_session(utc_ns(), keys.swarm_mark)
        quiet_ns = session_store.quiet_ns(round(config.link_timeout_s * 1e9))
        core = BrokerCore(
            NodeIdentity(
                node.hardware,
                node.platform,
                node.config.unit,
                PlatformCode[node.config.kind.upper()],
                self.module.clock.boot_id,
                keys.curve_public if keys.is_open else b"",
            ),
            config,
            session,
            former=RestartState(session_store.declared_period_ns, quiet_ns),
            now_ns=now_ns,
            chance=random.random,
            membership=SwarmMembership()
            if keys.is_open
            else SwarmMembership(
                RosterExchange(keys, node.hardware, random.random), keys, True, keys.curve_of
            ),
            channels=ChannelTable(load_channels(node.config_dir)),
        )
        if keys.roster is not None:
            core.add_members((member.platform for member in keys.roster.valid()), now_ns)
        return core
