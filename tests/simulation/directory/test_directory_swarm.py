"""Real neighbour and directory cores of moving swarms in virtual time: no loop ever, routes that come back.

200 seeds, each a swarm of 100 nodes: a random geometric graph of radios (300 m, mean degree 9, delivery
98 % inside 0.7 R, falling to nothing at 1.15 R), beacons at 10 Hz, encoded and decoded as on the wire, the
daemon's own timeouts. All start at once; for a second they move at 20 m/s while 12 of them crash, some
for good, some back after 50 ms to 1 s (also within the link timeout, also with a clock that went back).
Datagrams are delayed by up to 60 ms, so they cross every change of state. Every quarter of a second and
at every crash and start all 10 000 next hops are followed: a loop at any of these instants fails the seed.
When the churn is over, 99 % of the pairs that good links connect must have a working route within six
seconds.

Run as a program it takes two seed numbers and prints one line of JSON for each seed between them.
"""

import contextlib
import heapq
import math
import random
import subprocess
import sys
from collections.abc import Iterator
from typing import Final

import msgspec
import numpy as np
import pytest

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BODY_LIMIT, Beacon, Header, Hello, PlatformCode
from swarmd.broker.core.topology.neighbour import LISTING_NS
from swarmd.broker.core.topology.topology import RouteChanged, Topology

SECOND: Final = 1_000_000_000
RADIO_M: Final = 300.0
DEGREE: Final = 9.0
DELAY_NS: Final = 60_000_000
ROOM: Final = 1000
LISTING_MS: Final = LISTING_NS // 1_000_000
QUIET_NS: Final = 1_250_000_000
"""Longest time until everybody has noticed a restart: link timeout, a beacon, the delay, and some."""
CHURN_S: Final = 1.0
"""Virtual time in which nodes move and crash; the last ones start again a second later."""
SETTLED_S: Final = 8.0
"""By then the routes must be back."""
SEEDS: Final = 200
NODES: Final = 100


class Node:
    """One node of the simulated swarm: its core, or nothing while it is down."""

    __slots__ = ("back_ns", "generation", "hw", "links", "period_ns", "session", "sessions", "topology")

    def __init__(self, hw: int) -> None:
        self.hw = hw
        self.back_ns = 0
        """When it starts again, while it is down."""
        self.generation = 0
        self.period_ns = 0
        self.session = 0
        self.links: list[tuple[int, float]] = []
        self.topology: Topology | None = None
        self.sessions: dict[int, int] = {}


class Swarm:
    """A swarm in virtual time."""

    def __init__(self, seed: int, nodes: int, beacon_period_ns: int, speed_m_s: float) -> None:
        self.random = random.Random(seed)
        self.np_random = np.random.default_rng(seed)
        self.count = nodes
        self.beacon_period_ns = beacon_period_ns
        self.speed_m_s = speed_m_s
        self.side_m = math.sqrt(nodes * math.pi * RADIO_M**2 / DEGREE)
        self.position = self.np_random.uniform(0, self.side_m, (nodes, 2))
        self.heading = self.np_random.uniform(0, 2 * math.pi, nodes)
        self.nodes = [Node(index + 1) for index in range(nodes)]
        self.next_hop = np.zeros((nodes + 1, nodes + 1), dtype=np.int32)
        """[node, destination] → neighbour, kept from the cores' change events alone; 0: no route."""
        self.now_ns = 0
        self.count_up = 0
        self.events: list[tuple[int, int, int, int, Header | None, Beacon | None]] = []
        self.sent_bytes = 0
        self.look()
        for node in self.nodes:
            self.start(node, 0, late=False, quiet_ns=0)

    # the world

    def look(self) -> None:
        """Who can hear whom, and how well."""
        apart = self.position[:, None, :] - self.position[None, :, :]
        distance = np.sqrt((apart**2).sum(axis=2)) / RADIO_M
        self.delivery = np.clip((1.15 - distance) / 0.45, 0, 1) * 0.98
        np.fill_diagonal(self.delivery, 0)
        for node, row in zip(self.nodes, self.delivery, strict=True):
            node.links = [(int(peer), float(row[peer])) for peer in np.nonzero(row > 0.02)[0]]

    def move(self, dt_s: float) -> None:
        """Straight on, now and then another way, back at the edge."""
        turn = self.np_random.random(self.count) < 0.1
        self.heading = np.where(turn, self.np_random.uniform(0, 2 * math.pi, self.count), self.heading)
        step = np.stack((np.cos(self.heading), np.sin(self.heading)), axis=1) * self.speed_m_s * dt_s
        self.position = np.clip(self.position + step, 0, self.side_m)
        self.look()

    # the nodes

    def start(self, node: Node, now_ns: int, late: bool, quiet_ns: int = QUIET_NS) -> None:
        """Starts a node; `late`: with a clock that is somewhere else than before."""
        base = self.random.randrange(1 << 31) if late else 1 + now_ns // 100_000_000
        node.topology = Topology(node.hw, base, SECOND, now_ns + quiet_ns)
        node.generation += 1
        node.session = node.session + 1
        node.period_ns = 0
        node.sessions = {}
        self.push(
            now_ns + self.random.randrange(self.beacon_period_ns), node.hw - 1, node.generation, None, None
        )

    def period_ns(self, _topology: Topology) -> int:
        """Time from a node's beacon to its next."""
        return self.beacon_period_ns

    def stop(self, node: Node) -> None:
        """Takes a node away without a word."""
        node.topology = None
        self.next_hop[node.hw, :] = 0

    def push(
        self, at_ns: int, index: int, generation: int, header: Header | None, beacon: Beacon | None
    ) -> None:
        self.count_up += 1
        heapq.heappush(self.events, (at_ns, self.count_up, index, generation, header, beacon))

    def run(self, until_ns: int) -> None:
        """Until an instant of virtual time."""
        events = self.events
        while events and events[0][0] <= until_ns:
            self.now_ns, _, index, generation, header, beacon = heapq.heappop(events)
            node = self.nodes[index]
            if node.topology is None or node.generation != generation:
                continue
            if header is None or beacon is None:
                self.send(node, node.topology)
            else:
                self.receive(node, node.topology, header, beacon)
        self.now_ns = until_ns

    def send(self, node: Node, topology: Topology) -> None:
        now_ns = self.now_ns
        _, routes = topology.advance(now_ns)
        self.follow(node, routes)
        shape = topology.compose(now_ns, ROOM)
        sequence = topology.next_sequence()
        header = Header(0, node.hw, sequence, (now_ns // 1000) & 0xFFFF_FFFF, node.session)
        period_ns = self.period_ns(topology)
        hello = Hello(1, 0, 1, 1, 0, PlatformCode.UAV, "uav", b"", period_ns // 1_000_000, LISTING_MS)
        declared = hello if period_ns > node.period_ns or sequence % 10 == 0 else None
        node.period_ns = period_ns
        body = codec.encode(Beacon(declared, shape.echoes, shape.rows, shape.requests))
        assert len(body) <= BODY_LIMIT
        codec.encode_header(header)
        beacon = codec.decode(body)  # once for all receivers: it is the same for each of them
        topology.sent(sequence, now_ns)
        self.sent_bytes += len(body) - (codec.hello_bytes(hello) if declared is not None else 0)
        chance = self.random.random
        for peer, delivery in node.links:
            if chance() < delivery:
                delay_ns = int(chance() * DELAY_NS)
                self.push(now_ns + delay_ns, peer, self.nodes[peer].generation, header, beacon)
        self.push(
            now_ns + period_ns * self.random.randrange(95, 106) // 100,
            node.hw - 1,
            node.generation,
            None,
            None,
        )

    def receive(self, node: Node, topology: Topology, header: Header, beacon: Beacon) -> None:
        assert header.session is not None
        known = node.sessions.get(header.sender_hw)
        if known is not None and header.session < known:
            return
        restarted = known is not None and header.session > known
        node.sessions[header.sender_hw] = header.session
        heard = topology.on_beacon(header, beacon, restarted, ("10.0.0.1", 1), self.now_ns)
        assert heard is not None
        if heard.routes:
            self.follow(node, heard.routes)

    def follow(self, node: Node, routes: list[RouteChanged]) -> None:
        for change in routes:
            self.next_hop[node.hw, change.hw] = change.via

    # what must hold

    def assert_no_loop(self) -> None:
        """Following next hops from any node to any destination ends: there, or where no route is."""
        hop = self.next_hop.copy()
        everyone = np.arange(self.count + 1)
        hop[everyone, everyone] = 0
        columns = np.broadcast_to(everyone, hop.shape)
        for _ in range(math.ceil(math.log2(self.count + 1))):
            hop = hop[hop, columns]  # row 0 stays 0: no route is the end of the way
        looping = np.argwhere(hop != 0)
        assert not len(looping), (
            f"routing loop at {self.now_ns / SECOND:.2f} s towards node {looping[0][1]} from {looping[0][0]}"
        )

    def reached(self, least: float = 0.02) -> tuple[int, int]:
        """Pairs that good links connect, and those whose next hops lead there over links above `least`."""
        alive = np.array([node.topology is not None for node in self.nodes])
        usable = (self.delivery > least) & alive[:, None] & alive[None, :]
        good = (self.delivery > 0.85) & usable
        connected = good | np.eye(self.count, dtype=bool)
        for _ in range(math.ceil(math.log2(self.count))):
            connected = (connected.astype(np.uint8) @ connected.astype(np.uint8)) > 0
        np.fill_diagonal(connected, False)
        connected &= alive[:, None] & alive[None, :]
        hop = self.next_hop
        at = np.broadcast_to(np.arange(1, self.count + 1)[:, None], (self.count, self.count)).copy()
        goal = np.broadcast_to(np.arange(1, self.count + 1)[None, :], at.shape)
        for _ in range(self.count):
            step = hop[at, goal]
            usable_step = (step > 0) & usable[at - 1, np.maximum(step, 1) - 1]
            moving = (at != goal) & usable_step
            if not moving.any():
                break
            at = np.where(moving, step, at)
        arrived = at == goal
        return int(connected.sum()), int((connected & arrived).sum())


def lifetimes(swarm: Swarm) -> Iterator[tuple[int, int, str]]:
    """When which node crashes and starts again."""
    for index in swarm.random.sample(range(swarm.count), swarm.count // 8):
        down_ns = int(swarm.random.uniform(0.3, CHURN_S) * SECOND)
        yield down_ns, index, "crash"
        if swarm.random.random() < 0.7:
            away_s = swarm.random.choice((0.05, 0.2, 0.5, 1.0))
            yield down_ns + int(away_s * SECOND), index, swarm.random.choice(("start", "start late"))


def fly(seed: int, nodes: int = NODES) -> float:
    """One swarm's life; returns the second at which 99 % of the connected pairs had their route back.

    Raises: AssertionError on a loop at any looked-at instant, or when the routes stay away.
    """
    swarm = Swarm(seed, nodes, SECOND // 10, speed_m_s=20.0)
    step_ns = SECOND // 4
    life = sorted(lifetimes(swarm))
    connected = arrived = 0
    for at_ns in range(step_ns, int(SETTLED_S * SECOND) + 1, step_ns):
        while life and life[0][0] <= at_ns:
            when_ns, index, what = life.pop(0)
            swarm.run(when_ns)
            swarm.assert_no_loop()
            if what == "crash":
                swarm.stop(swarm.nodes[index])
            else:
                swarm.start(swarm.nodes[index], when_ns, late=what == "start late")
        swarm.run(at_ns)
        swarm.assert_no_loop()
        if at_ns <= CHURN_S * SECOND:
            swarm.move(step_ns / SECOND)
        elif not life:
            connected, arrived = swarm.reached()
            assert connected > nodes, f"the graph fell apart: {connected} pairs"
            if arrived >= 0.99 * connected:
                return at_ns / SECOND
    raise AssertionError(f"{arrived} of {connected} connected pairs have a route that works")


class Life(msgspec.Struct, frozen=True):
    """What became of one seed."""

    seed: int
    settled_s: float
    """-1: see `error`."""
    error: str = ""


def live(seed: int) -> Life:
    """One seed's swarm, its failure as a result."""
    try:
        return Life(seed, fly(seed))
    except AssertionError as error:
        return Life(seed, -1, str(error))


@pytest.mark.slow
@pytest.mark.timeout(900)  # a minute on two idle cores
def test_200_moving_swarms_of_100_nodes_never_loop_and_get_their_routes_back() -> None:
    half = SEEDS // 2
    halves = [(0, half), (half, SEEDS)]
    with contextlib.ExitStack() as stack:
        programs = [
            stack.enter_context(
                subprocess.Popen([sys.executable, __file__, str(first), str(last)], stdout=subprocess.PIPE)
            )
            for first, last in halves
        ]
        for program in programs:
            stack.callback(program.kill)
        lives = [
            msgspec.json.decode(line, type=Life)
            for program in programs
            for line in program.communicate()[0].splitlines()
        ]
    failed = [f"seed {life.seed}: {life.error}" for life in lives if life.error]
    assert not failed, "\n".join(failed)
    assert sorted(life.seed for life in lives) == list(range(SEEDS))


if __name__ == "__main__":
    for number in range(int(sys.argv[1]), int(sys.argv[2])):
        print(msgspec.json.encode(live(number)).decode(), flush=True)
