"""Tables of neighbours, routes and traffic, for the boards and the replies of the broker."""

from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core.beacon.beacon import INFINITY, PlatformCode
from swarmd.broker.core.beacon_protocol import BeaconProtocol
from swarmd.broker.core.frames.carrier_choice import LinkQuality
from swarmd.broker.core.membership.other_swarms import OtherSwarms
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.media.medium_link import MediumLink
from swarmd.broker.core.swarm.neighbour import Neighbour
from swarmd.broker.core.swarm.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.model.names import MAIN
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.net import (
    ConnectionStatus,
    LinkStatus,
    LinkTransport,
    MediumState,
    MediumUse,
    Neighbours,
    NeighbourState,
    Routes,
    RouteState,
)
from swarmware.types.outage import NodeLinks
from swarmware.types.traffic import CERTAINLY_HOSTILE, HOSTILE, Refused, Traffic

_FULL: Final = 255
"""Quality of a link without loss."""
_FRAMES_NS: Final = 5_000_000_000
"""A medium by which packets came within this time is shown as the medium of incoming frames."""
_USES: Final = {
    (False, False): MediumUse.NONE,
    (True, False): MediumUse.OUT,
    (False, True): MediumUse.IN,
    (True, True): MediumUse.BOTH,
}

LINK_STATUS: Final = {
    LinkState.DOWN: LinkStatus.DOWN,
    LinkState.HEARD: LinkStatus.RECEIVED,
    LinkState.UP: LinkStatus.UP,
    LinkState.HALF_OPEN: LinkStatus.HALF_OPEN,
}


class PublishTables(msgspec.Struct, frozen=True):
    """Action: write the tables of neighbours and routes."""

    traffic: bool
    """Also the traffic counters."""


class NetReport:
    """Builds the tables of neighbours, routes and traffic."""

    def __init__(
        self,
        protocol: BeaconProtocol,
        topology: Topology,
        counters: Counters,
        other_swarms: OtherSwarms,
        since_ns: int,
    ) -> None:
        self._nodes = protocol.nodes
        self._published = protocol.published
        self._channels = protocol.channels
        self._slowdown = protocol.slowdown
        self._beacon_hz = protocol.beacon_hz
        self._neighbours = topology.neighbours
        self._routing = topology.routing
        self._counters = counters
        self._other_swarms = other_swarms
        self._since_ns = since_ns

    def neighbours(self, connection_of: Callable[[int], ConnectionStatus], now_ns: int) -> Neighbours:
        """Table of all nodes received within the last minutes.

        `connection_of`: state of the connection to a neighbour.
        """
        return Neighbours(
            tuple(
                self._neighbour(neighbour, connection_of(neighbour.hw), now_ns)
                for neighbour in self._neighbours.all()
            )
        )

    def _neighbour(self, neighbour: Neighbour, connection: ConnectionStatus, now_ns: int) -> NeighbourState:
        member = self._nodes.get(neighbour.hw)
        hello = neighbour.hello
        up = neighbour.state is LinkState.UP
        return NeighbourState(
            platform=member.platform if member is not None else "",
            unit=member.unit if member is not None else "",
            hardware=neighbour.hw,
            kind=PlatformKind((hello.kind if hello is not None else PlatformCode.OTHER).name.lower()),
            state=LINK_STATUS[neighbour.state],
            address=f"{neighbour.address[0]}:{neighbour.address[1]}",
            since_ns=neighbour.since_ns,
            silent_s=round((now_ns - neighbour.received_ns) / 1e9, 3),
            tick_hz=round(1e9 / neighbour.period_ns, 2) if neighbour.period_ns > 0 else 0.0,
            loss_in_ratio=round(1 - neighbour.quality / _FULL, 3),
            loss_out_ratio=round(1 - neighbour.quality_out / _FULL, 3),
            rtt_ms=round(neighbour.rtt_ns / 1e6, 4) if neighbour.rtt_ns else None,
            cost=neighbour.cost if up else INFINITY,
            tree_version=hello.tree_version if hello is not None else 0,
            mission=hello.mission if hello is not None else 0,
            boot_id=hello.boot_id if hello is not None else 0,
            transport=connection,
            multicast=not neighbour.by_unicast,
            media=tuple(
                _medium_state(one, one is neighbour.best_link, now_ns) for one in neighbour.media.values()
            ),
        )

    def link_qualities(self, now_ns: int) -> list[tuple[int, LinkQuality]]:
        """Quality of the links that are up and measured, by hardware id of the neighbour; with several
        media, the quality of the medium that carries the frames."""
        found: list[tuple[int, LinkQuality]] = []
        for one in self._neighbours.up():
            loss = one.wire_loss
            if loss is None:
                continue
            silence = 1 - min(one.quality, one.reported) / _FULL
            if (best := one.best_link) is not None:
                loss = silence = 1 - min(best.quality_in(now_ns), best.quality_out(now_ns)) / _FULL
            found.append((one.hw, LinkQuality(loss, one.rtt_ns, silence)))
        return found

    def links(self, waiting: Callable[[int], tuple[int, int]], outages: int, now_ns: int) -> NodeLinks:
        """Summary of all links, for health rules.

        `waiting`: frames and bytes that wait for a neighbour; `outages`: links that are lost now.
        """
        found = self._neighbours.all()
        losses = [quality.loss for _, quality in self.link_qualities(now_ns)]
        trips_ns = [one.rtt_ns for one in found if one.state is LinkState.UP and one.rtt_ns]
        queues = [waiting(one.hw) for one in found]
        return NodeLinks(
            up=sum(one.state is LinkState.UP for one in found),
            half_open=sum(one.state is LinkState.HALF_OPEN for one in found),
            best_loss_ratio=round(min(losses), 3) if losses else None,
            worst_loss_ratio=round(max(losses), 3) if losses else None,
            worst_rtt_ms=round(max(trips_ns) / 1e6, 4) if trips_ns else None,
            outages=outages,
            waiting_frames=sum(frames for frames, _ in queues),
            waiting_bytes=sum(size for _, size in queues),
        )

    def routes(self) -> Routes:
        """Table of all reachable nodes."""
        members = self._nodes
        out: list[RouteState] = []
        for route in self._routing.routes():
            member = members.get(route.hw)
            out.append(
                RouteState(
                    platform=members.platform(route.hw),
                    hardware=route.hw,
                    via=members.name(route.via),
                    metric=route.metric,
                    hops=1 if route.via == route.hw else max(2, round(route.metric / 256)),
                    tree_version=member.tree_version if member is not None else 0,
                    since_ns=route.changed_ns,
                    unit=member.unit if member is not None else MAIN,
                )
            )
        return Routes(tuple(out))

    def traffic(self, now_ns: int) -> Traffic:
        """Table of all traffic counters; the caller has brought the counters of connections up to date."""
        counters = self._counters
        lost = 0
        for neighbour in self._neighbours.all():
            link = counters.link(self._nodes.name(neighbour.hw), LinkTransport.UDP)
            link.lost = neighbour.lost
            link.late = neighbour.late
            lost += neighbour.lost
        for board in self._published.boards.values():
            counters.channel(board.path).held_back = board.held_back
        for name, channel in counters.channels.items():
            channel.max_hz = self._channels.max_hz(name)
        return Traffic(
            since_ns=self._since_ns,
            at_ns=now_ns,
            sent_bytes=counters.udp_sent_bytes + counters.tcp_sent_bytes,
            received_bytes=counters.udp_received_bytes + counters.tcp_received_bytes,
            udp_sent_bytes=counters.udp_sent_bytes,
            udp_received_bytes=counters.udp_received_bytes,
            tcp_sent_bytes=counters.tcp_sent_bytes,
            tcp_received_bytes=counters.tcp_received_bytes,
            sent_datagrams=counters.sent_datagrams,
            received_datagrams=counters.received_datagrams,
            lost_datagrams=lost,
            sent_frames=counters.sent_frames,
            received_frames=counters.received_frames,
            forwarded_frames=counters.forwarded_frames,
            requests=counters.requests,
            notifications=counters.notifications,
            tick_hz=round(self._beacon_hz(), 2),
            refused=counters.refused_table(),
            links=counters.link_table(),
            channels=counters.channel_table(),
            failed_ticks=counters.failed_ticks,
            slowed_ticks=self._slowdown.delayed_beacons,
            slowdown=round(self._slowdown.factor, 2),
            other_swarms=self._other_swarms.table(now_ns),
        )


def _medium_state(link: MediumLink, is_best: bool, now_ns: int) -> MediumState:
    quality_in, quality_out = link.quality_in(now_ns), link.quality_out(now_ns)
    both = LinkStatus.UP if quality_out else LinkStatus.HALF_OPEN
    state = both if quality_in else LinkStatus.DOWN
    takes = now_ns - link.frames_ns < _FRAMES_NS
    return MediumState(
        link.medium.name,
        state,
        f"{link.address[0]}:{link.address[1]}" if link.address[1] else link.address[0],
        round(1 - quality_in / _FULL, 3),
        round(1 - quality_out / _FULL, 3),
        round(link.silent_ns(now_ns) / 1e9, 3),
        link.medium.rate_bit_s,
        link.cost_out(now_ns) if state is LinkStatus.UP else INFINITY,
        _USES[is_best, takes],
    )


LOG_NS: Final = 60_000_000_000
"""Minimum period between two lines of one level."""


class RefusalLine(NamedTuple):
    """A line for the journal."""

    is_warning: bool
    """An operator should act, because the input has forms that no valid member sends."""
    text: str


class RefusalLog:
    """Compares the counters of refused input with their state at the last line."""

    def __init__(self) -> None:
        self._logged = dict.fromkeys(HOSTILE, 0)
        self._logged_ns = {True: -LOG_NS, False: -LOG_NS}
        """Instant of the last warning, and of the last other line."""

    def on_counters(self, refused: Refused, now_ns: int) -> RefusalLine | None:
        """The line that is due now, or None if the last line is recent or nothing was refused since."""
        counts = msgspec.structs.asdict(refused)
        risen = {name: counts[name] - self._logged[name] for name in HOSTILE}
        is_warning = any(risen[name] > 0 for name in CERTAINLY_HOSTILE)
        found = ", ".join(f"{count} {name}" for name, count in risen.items() if count > 0)
        if not found or now_ns - self._logged_ns[is_warning] < LOG_NS:
            return None
        self._logged = {name: counts[name] for name in HOSTILE}
        self._logged_ns[is_warning] = now_ns
        return RefusalLine(is_warning, f"refused input: {found}")
