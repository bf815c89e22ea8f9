"""Swarms of brokers whose routes are followed at each change: no loop ever, routes that lead there."""

import math
from typing import Final, NamedTuple

import numpy as np
from tests.simulation.directory.brokers import BrokerNode
from tests.simulation.directory.radios import RadioSwarm, Ratios

from swarmd.broker.config import Config
from swarmd.broker.core.beacon.declared_period import RestartState
from swarmd.broker.core.swarm.neighbour import notice_ns
from swarmd.broker.core.swarm.routes.routing_table import RouteChanged
from swarmware.model.names import data_id, hardware_id
from swarmware.testing.virtual import VirtualClock
from swarmware.types.net import BoardPublication, TreePlan

Pairs = np.ndarray[tuple[int, int], np.dtype[np.bool_]]
Transmissions = np.ndarray[tuple[int, int], np.dtype[np.float32]]

SECOND: Final = 1_000_000_000
GOOD_DELIVERY: Final = 0.85
"""A link of the graph that says which pairs can have a route."""
DEGREE: Final = 9.0
DELAY_S: Final = (0.0, 0.06)
"""Datagrams cross every change of state."""
LINK_TIMEOUT_NS: Final = round(Config().link_timeout_s * SECOND)
SESSIONS: Final = 100_000_000
"""Sessions that begin with the same sequence number of beacons."""
POSE: Final = data_id("nav/pose", "Pose")
PLAN: Final = TreePlan(1, (BoardPublication("nav/pose", POSE, "Pose"),))


def write_pose(node: BrokerNode, now_ns: int) -> None:
    """The vehicle moves: every beacon has a new pose."""
    node.core.published.boards[POSE].put(now_ns.to_bytes(25, "little"), True, now_ns)


class Swarm(RadioSwarm):
    """Brokers of moving vehicles on a square; they start, crash and start again."""

    def __init__(
        self,
        seed: int,
        count: int,
        *,
        tick_hz: float = 10.0,
        speed_m_s: float,
        subscribed: bool = True,
        loss: float = 0.0,
    ) -> None:
        """`subscribed`: whether other nodes subscribe to the poses, so that all send at `tick_hz`."""
        super().__init__(seed, count, DEGREE, delay_s=DELAY_S, loss=loss)
        self.config = Config(tick_hz=tick_hz, relay_bytes_s=0.0)  # values of others change no route
        self.subscribed = subscribed
        self.speed_m_s = speed_m_s
        self.heading = self.draw.uniform(0, 2 * math.pi, count)
        self.brokers: dict[str, BrokerNode] = {}
        self.changes = 0
        """Changes of routes, each of which was followed."""
        self.sessions = dict.fromkeys(self.names, 0)
        self.index = {name: number for number, name in enumerate(self.names, 1)}
        """Numbers of the nodes, by name and by hardware id in hex."""
        self.index |= {f"{hardware_id(name):08x}": number for name, number in self.index.items()}
        self.number = {hardware_id(name): number for number, name in enumerate(self.names, 1)} | {0: 0}
        """Index of each node by its hardware id, or 0 for no node."""
        self.next_hop = np.zeros((count + 1, count + 1), dtype=np.int32)
        """[node, destination] → neighbour, from all changes of routes, or 0 without a route."""
        for name in self.names:
            first_ns = self.random.randrange(round(SECOND / tick_hz))
            self.at(first_ns, lambda name=name: self.start(name, late=False, former=RestartState()))  # type: ignore[misc]  # the name of this iteration

    def start(self, name: str, *, late: bool, former: RestartState) -> None:
        """Starts a broker; `late`: with a clock that is somewhere else than before."""
        wall = self.random.randrange(1 << 31) if late else 1 + self.now_ns // SESSIONS
        self.sessions[name] += 1
        session = wall * SESSIONS + self.sessions[name]
        node = BrokerNode(
            self,
            name,
            VirtualClock(self),
            config=self.config,
            session=session,
            former=former,
            write_boards=write_pose if self.subscribed else lambda *_: None,
            on_routes=self.on_routes,
        )
        self.brokers[name] = node
        if self.subscribed:
            node.driver.feed(node.core.on_plan(PLAN, self.now_ns))

    def crash(self, name: str) -> RestartState:
        """Takes a broker away without a word; returns what it stored."""
        node = self.brokers.pop(name)
        node.stop()
        self.next_hop[self.index[name], :] = 0
        period_ns = node.declared_period_ns
        return RestartState(period_ns, notice_ns(period_ns, LINK_TIMEOUT_NS))

    def move(self, dt_s: float) -> None:
        """Straight on, now and then another way, back at the edge."""
        count = len(self.names)
        turn = self.draw.random(count) < 0.1
        self.heading = np.where(turn, self.draw.uniform(0, 2 * math.pi, count), self.heading)
        step = np.stack((np.cos(self.heading), np.sin(self.heading)), axis=1) * self.speed_m_s * dt_s
        self.place(np.clip(self.position + step, 0, self.side_m))

    # what must hold

    def on_routes(self, node: BrokerNode, changes: list[RouteChanged]) -> None:
        """Routes of a node have changed: following the new ones does not lead back to it."""
        number, next_hop = self.number, self.next_hop
        first = number[node.hw]
        row = next_hop[first]
        self.changes += len(changes)
        for change in changes:  # all of them are in force before the next event
            row[number[change.hw]] = number[change.via]
        for change in changes:
            goal = number[change.hw]
            at = int(row[goal])
            while at not in (0, goal):
                assert at != first, (
                    f"seed {self.seed}: loop at {self.now_ns / SECOND:.3f} s from {node.name} towards"
                    f" {self.names[goal - 1]}"
                )
                at = int(next_hop[at, goal])

    def assert_published(self) -> None:
        """The routes that the nodes publish are those that were followed."""
        for name, node in self.brokers.items():
            row = np.zeros(len(self.names) + 1, dtype=np.int32)
            for route in node.core.report.routes().routes:
                row[self.number[route.hardware]] = self.index[route.via]
            assert (row == self.next_hop[self.index[name]]).all(), name

    def follow(self, delivery_min: float) -> "Followed":
        """Follows all next hops over the links that deliver at least `delivery_min`."""
        count = len(self.names)
        alive = np.array([name in self.brokers for name in self.names])
        usable = (self.delivery > delivery_min) & alive[:, None] & alive[None, :]
        good = (self.delivery > GOOD_DELIVERY) & usable
        connected = good | np.eye(count, dtype=bool)
        for _ in range(math.ceil(math.log2(count))):
            connected = (connected.astype(np.float32) @ connected.astype(np.float32)) > 0
        np.fill_diagonal(connected, False)
        connected &= alive[:, None] & alive[None, :]
        cost = transmissions(self.delivery, usable)
        hop = self.next_hop
        at = np.broadcast_to(np.arange(1, count + 1)[:, None], (count, count)).copy()
        goal = np.broadcast_to(np.arange(1, count + 1)[None, :], at.shape)
        spent: Transmissions = np.zeros((count, count), dtype=np.float32)
        for _ in range(count):
            step = hop[at, goal]
            usable_step = (step > 0) & usable[at - 1, np.maximum(step, 1) - 1]
            moving = (at != goal) & usable_step
            if not moving.any():
                break
            spent += np.where(moving, cost[at - 1, np.maximum(step, 1) - 1], 0)
            at = np.where(moving, step, at)
        return Followed(connected, connected & (at == goal), spent, cost)


class Followed(NamedTuple):
    """Routes at one instant, by [node, destination]."""

    connected: Pairs
    """Pairs that good links connect."""
    arrived: Pairs
    """Pairs whose next hops lead to the destination over usable links."""
    spent: Transmissions
    """Expected transmissions of their routes."""
    cost: Transmissions
    """Expected transmissions of each usable link; infinite: none."""

    def stretch(self) -> float:
        """Expected transmissions of a route as a multiple of the best path, as a mean of the pairs."""
        best = self.cost.copy()
        np.fill_diagonal(best, 0)
        for _ in range(math.ceil(math.log2(len(best)))):
            best = np.array([(row[:, None] + best).min(axis=0) for row in best], dtype=np.float32)
        found = self.spent[self.arrived] / best[self.arrived]
        return float(found.mean()) if len(found) else math.nan


def transmissions(delivery: Ratios, usable: Pairs) -> Transmissions:
    """Expected transmissions over each link until a frame and its acknowledgement have arrived."""
    cost = np.full(delivery.shape, np.inf, dtype=np.float32)
    cost[usable] = 1 / delivery[usable] ** 2
    return cost
