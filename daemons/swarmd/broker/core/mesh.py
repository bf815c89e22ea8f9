"""Neighbours and directory together: what a tick says about the swarm's shape, in and out."""

from typing import Final

import msgspec

from swarmd.broker.core.directory import HYSTERESIS, Directory, RouteChanged, newer
from swarmd.broker.core.link import LinkChanged, LinkEvent, LinkState
from swarmd.broker.core.neighbour import Neighbour, Neighbours
from swarmd.broker.core.tick import (
    ECHO_BYTES,
    NEVER_NS,
    REQUEST_BYTES,
    ROW_BYTES,
    Echo,
    Header,
    Row,
    SequenceRequest,
    Tick,
)
from swarmd.broker.core.timing import Timing

CHANGING_NS: Final = 5_000_000_000
"""After a link came up or went down, another one is likely to: the swarm moves."""
NEW_NS: Final = 1_500_000_000
"""For so long after its first datagram a node that was started again names its session in all of them."""
ROWS_MAX: Final = 60
"""Rows in one datagram: 480 of its 1 238 bytes at most, the rest is for values."""
_JUMP_MAX: Final = 0x7FFF
JUMPS: Final = 4
"""Raises of our own sequence number in a row: each holder of a number of a former session may need one."""
JUMP_AGAIN_NS: Final = 60_000_000_000
"""Then one more in this time: 2³¹ numbers last for 45 days of continued requests."""
JUMP_CEILING: Final = 0xF000_0000
"""Above this the number only counts datagrams: 310 days at 10 Hz until a new session must begin."""


class Heard(msgspec.Struct, frozen=True, gc=False):
    """What one datagram changed."""

    neighbour: Neighbour
    fresh: bool
    """Not overtaken by a later one of the same sender."""
    timing: Timing | None
    links: list[LinkChanged]
    routes: list[RouteChanged]


class Shape(msgspec.Struct, frozen=True, gc=False):
    """The next datagram's part about the swarm's shape."""

    echoes: tuple[Echo, ...]
    rows: tuple[Row, ...]
    requests: tuple[SequenceRequest, ...]


class Mesh:
    """The swarm as one node sees it."""

    def __init__(self, own_hw: int, first_sequence: int, link_timeout_ns: int, quiet_until_ns: int) -> None:
        """`quiet_until_ns`: from when on routes over more than one hop are taken.

        A node that started anew has forgotten its feasibility distances, while others may still
        send through it: until they have taken the link to its former session down (`notice_ns`), a
        row it hears may be its own route come back.
        """
        self.own_hw = own_hw
        self._quiet_until_ns = quiet_until_ns
        self._new_until_ns = quiet_until_ns
        self.neighbours = Neighbours(own_hw, link_timeout_ns)
        self.directory = Directory(own_hw)
        self._sequence = first_sequence
        self._jumps: list[int] = []
        """When our number was raised, the last few times."""
        self._composed_ns = NEVER_NS
        self._changed_ns = NEVER_NS

    def on_tick(
        self, header: Header, tick: Tick, restarted: bool, address: tuple[str, int], rx_ns: int
    ) -> Heard | None:
        """A datagram that was opened. None: there is no room for another neighbour."""
        links: list[LinkChanged] = []
        neighbour = self.neighbours.on_header(header, restarted, address, rx_ns, links)
        if neighbour is None:
            return None
        routes: list[RouteChanged] = []
        if tick.hello is not None:
            self.neighbours.on_hello(neighbour, header, tick.hello)
        fresh = neighbour.top == header.sequence
        timing = self.neighbours.on_echoes(neighbour, header, tick.echoes, rx_ns, links)
        directory = self.directory
        if links:
            self._look(links, rx_ns)
            for change in links:
                if change.before is LinkState.UP:
                    routes += directory.drop_link(header.sender_hw, rx_ns)
        if neighbour.state is LinkState.UP:
            routes += self._price(neighbour, rx_ns)
            if fresh:
                own = ((header.sender_hw, header.sequence & 0xFFFF, 0),)
                rows = own + tick.rows if rx_ns >= self._quiet_until_ns else own
                routes += directory.on_rows(header.sender_hw, rows, rx_ns)
        if tick.requests:
            routes += directory.on_requests(header.sender_hw, tick.requests, rx_ns)
        return Heard(neighbour, fresh, timing, links, routes)

    def on_timer(self, now_ns: int) -> tuple[list[LinkChanged], list[RouteChanged]]:
        """Deadlines of links and ages of routes."""
        links = self.neighbours.on_timer(now_ns)
        routes: list[RouteChanged] = []
        self._look(links, now_ns)
        for change in links:
            if change.before is LinkState.UP:
                routes += self.directory.drop_link(change.hw, now_ns)
        for neighbour in self.neighbours.up():
            if neighbour.missed:
                routes += self._price(neighbour, now_ns)
        routes += self.directory.on_timer(now_ns)
        return links, routes

    def _price(self, neighbour: Neighbour, now_ns: int) -> list[RouteChanged]:
        """Tells the directory what a link costs, and when it became much dearer."""
        measured = (neighbour.window, neighbour.missed, neighbour.reported)
        if measured == neighbour.costed:
            return []
        neighbour.costed = measured
        cost = neighbour.cost
        self.directory.set_link(neighbour.hw, cost)
        if cost < neighbour.priced + HYSTERESIS:
            neighbour.priced = min(neighbour.priced, cost)
            return []
        neighbour.priced = cost
        return self.directory.worsen(neighbour.hw, now_ns)

    def _look(self, links: list[LinkChanged], now_ns: int) -> None:
        if any(LinkState.UP in (change.before, change.after) for change in links):
            self._changed_ns = now_ns

    def is_new(self, now_ns: int) -> bool:
        """Whether to say our session with each datagram: most links to the former one end by that."""
        return now_ns < self._new_until_ns

    def is_changing(self, now_ns: int, span_ns: int = CHANGING_NS) -> bool:
        """Whether links came up or went down within the last seconds."""
        return self._changed_ns != NEVER_NS and now_ns - self._changed_ns < span_ns

    def next_sequence(self) -> int:
        """Number of the next datagram: rises by one, or to what others still hold of us.

        After a start with a clock that went back they would take our rows for old ones. How often it
        is raised is limited: the numbers of a session are its nonces, and there are 2³² of them.
        """
        self._sequence += 1
        wanted = self.directory.wanted_sequence
        if wanted is not None:
            self.directory.wanted_sequence = None
            if newer(wanted, self._sequence & 0xFFFF) and self._may_jump():
                self._sequence += min((wanted - self._sequence & 0xFFFF) + 1, _JUMP_MAX)
        return self._sequence

    def _may_jump(self) -> bool:
        now_ns = self._composed_ns
        self._jumps = [at_ns for at_ns in self._jumps if now_ns - at_ns < JUMPS * JUMP_AGAIN_NS]
        if len(self._jumps) >= JUMPS or self._sequence > JUMP_CEILING:
            return False
        self._jumps.append(now_ns)
        return True

    def compose(self, now_ns: int, room: int) -> Shape:
        """What the next datagram says, in at most `room` bytes."""
        if self._composed_ns == NEVER_NS:
            self._new_until_ns = min(self._new_until_ns, now_ns + NEW_NS)
        self._composed_ns = now_ns
        listing_ns = self.neighbours.listing_ns()
        echoes = self.neighbours.echoes(now_ns, min(room * 3 // 4 // ECHO_BYTES, 255), listing_ns)
        requests = self.directory.requests(now_ns)[:32]
        room -= len(echoes) * ECHO_BYTES + len(requests) * REQUEST_BYTES
        linked = self.neighbours.linked(now_ns)
        rows = self.directory.rows(now_ns, max(0, min(ROWS_MAX, room // ROW_BYTES)), linked)
        return Shape(echoes, rows, requests)

    def sent(self, sequence: int, tx_ns: int) -> None:
        """The datagram left."""
        self.neighbours.sent(sequence, tx_ns)

    def deadline_ns(self) -> int | None:
        """When `on_timer` has to be called at the latest."""
        return self.neighbours.deadline_ns()


__all__ = ["Heard", "LinkChanged", "LinkEvent", "LinkState", "Mesh", "RouteChanged", "Shape", "Timing"]
