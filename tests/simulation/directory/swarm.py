"""Swarms of brokers whose routes are followed: no loop ever, and routes that lead to their destination."""

import math
from typing import Final

import numpy as np
from tests.simulation.directory.brokers import BrokerNode
from tests.simulation.directory.radios import RadioSwarm

from swarmd.broker.config import Config
from swarmd.broker.core.broker import FormerState
from swarmd.broker.core.topology.neighbour import notice_ns
from swarmware.model.names import data_id, hardware_id
from swarmware.testing.virtual import VirtualClock
from swarmware.types.net import BoardPublication, TreePlan

SECOND: Final = 1_000_000_000
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
        self._changed: dict[str, BrokerNode] = {}
        self.sessions = dict.fromkeys(self.names, 0)
        self.index = {name: number for number, name in enumerate(self.names, 1)}
        """Numbers of the nodes, by name and by hardware id in hex."""
        self.index |= {f"{hardware_id(name):08x}": number for name, number in self.index.items()}
        self.next_hop = np.zeros((count + 1, count + 1), dtype=np.int32)
        """[node, destination] → neighbour, from the route tables of the brokers; 0: no route."""
        for name in self.names:
            first_ns = self.random.randrange(round(SECOND / tick_hz))
            self.at(first_ns, lambda name=name: self.start(name, late=False, former=FormerState()))  # type: ignore[misc]  # the name of this iteration

    def start(self, name: str, *, late: bool, former: FormerState) -> None:
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
            on_tables=self.on_tables,
        )
        self.brokers[name] = node
        if self.subscribed:
            node.driver.feed(node.core.on_plan(PLAN, self.now_ns))

    def crash(self, name: str) -> FormerState:
        """Takes a broker away without a word; returns what it stored."""
        node = self.brokers.pop(name)
        node.stop()
        self.next_hop[self.index[name], :] = 0
        period_ns = node.declared_period_ns
        return FormerState(period_ns, notice_ns(period_ns, LINK_TIMEOUT_NS))

    def move(self, dt_s: float) -> None:
        """Straight on, now and then another way, back at the edge."""
        count = len(self.names)
        turn = self.draw.random(count) < 0.1
        self.heading = np.where(turn, self.draw.uniform(0, 2 * math.pi, count), self.heading)
        step = np.stack((np.cos(self.heading), np.sin(self.heading)), axis=1) * self.speed_m_s * dt_s
        self.place(np.clip(self.position + step, 0, self.side_m))

    # what must hold

    def on_tables(self, node: BrokerNode) -> None:
        """A route table is to be published: it is read before the next look at all of them."""
        self._changed[node.name] = node

    def read_routes(self) -> None:
        """Reads the route tables that were published since the last look."""
        for node in self._changed.values():
            if self.brokers.get(node.name) is node:
                self.read_routes_of(node)
        self._changed.clear()

    def read_routes_of(self, node: BrokerNode) -> None:
        """Reads the route table that a broker publishes."""
        row = self.next_hop[self.index[node.name]]
        row[:] = 0
        for route in node.core.report.routes().routes:
            row[self.index[f"{route.hardware:08x}"]] = self.index[route.via]

    def assert_no_loop(self) -> None:
        """Following next hops from any node to any destination ends: there, or where no route is."""
        self.read_routes()
        hop = self.next_hop.copy()
        everyone = np.arange(len(hop))
        hop[everyone, everyone] = 0
        columns = np.broadcast_to(everyone, hop.shape)
        for _ in range(math.ceil(math.log2(len(hop)))):
            hop = hop[hop, columns]  # row 0 stays 0: no route is the end of the way
        looping = np.argwhere(hop != 0)
        assert not len(looping), (
            f"routing loop at {self.now_ns / SECOND:.2f} s towards node {looping[0][1]} from {looping[0][0]}"
        )

    def reached(self, delivery_min: float = 0.02) -> tuple[int, int]:
        """Pairs that good links connect, and those whose next hops lead there over usable links."""
        count = len(self.names)
        alive = np.array([name in self.brokers for name in self.names])
        usable = (self.delivery > delivery_min) & alive[:, None] & alive[None, :]
        good = (self.delivery > 0.85) & usable
        connected = good | np.eye(count, dtype=bool)
        for _ in range(math.ceil(math.log2(count))):
            connected = (connected.astype(np.uint8) @ connected.astype(np.uint8)) > 0
        np.fill_diagonal(connected, False)
        connected &= alive[:, None] & alive[None, :]
        hop = self.next_hop
        at = np.broadcast_to(np.arange(1, count + 1)[:, None], (count, count)).copy()
        goal = np.broadcast_to(np.arange(1, count + 1)[None, :], at.shape)
        for _ in range(count):
            step = hop[at, goal]
            usable_step = (step > 0) & usable[at - 1, np.maximum(step, 1) - 1]
            moving = (at != goal) & usable_step
            if not moving.any():
                break
            at = np.where(moving, step, at)
        arrived = at == goal
        return int(connected.sum()), int((connected & arrived).sum())
