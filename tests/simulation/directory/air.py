"""Brokers that exchange beacons on one medium, in virtual time."""

from collections import defaultdict
from typing import Final

import numpy as np
from tests.simulation.directory.brokers import BrokerNode, SimulatedKeys
from tests.simulation.directory.radios import RadioSwarm

from swarmd.broker.config import Config
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmware.model.names import data_id, hardware_id
from swarmware.testing.virtual import VirtualClock
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan
from swarmware.types.vehicle import Pose

POSE: Final = data_id("nav/pose", "Pose")


DELAY_S: Final = (0.0002, 0.001)


class Air(RadioSwarm):
    """Brokers of moving vehicles, and the poses that each of them has received."""

    config = Config()

    def __init__(self, seed: int, count: int, degree: float, speed_m_s: float) -> None:
        super().__init__(seed, count, degree, delay_s=DELAY_S)
        self.velocity = self.draw.normal(0, speed_m_s / np.sqrt(2), (count, 2))
        self.made_s: dict[tuple[str, str], float] = {}
        """By receiver and origin: when the newest pose was made (a pose says so in its x)."""
        self.ages_s: dict[int, list[float]] = defaultdict(list)
        self.offset_s = {name: float(self.random.randrange(-5, 5)) for name in self.names}
        """Clock of each node minus the true one."""
        self.brokers: dict[str, BrokerNode] = {}
        for name in self.names:
            self.at(self.random.randrange(100_000_000), lambda name=name: self.start(name))  # type: ignore[misc]  # the name of this iteration

    def start(self, name: str) -> None:
        node = BrokerNode(
            self,
            name,
            VirtualClock(self, self.offset_s[name]),
            config=self.config,
            write_boards=self.write_pose,
            on_value=self.take_pose,
            signing=SimulatedKeys(name),
        )
        self.brokers[name] = node
        wants = tuple(
            BoardSubscription(other, "nav/pose", "Pose", POSE) for other in self.names if other != name
        )
        offers = (BoardPublication("nav/pose", POSE, "Pose"),)
        plan = TreePlan(hardware_id(name) & 0xFFFF, offers, wants)
        node.driver.feed(node.core.on_plan(plan, node.clock.now_ns()))

    def write_pose(self, node: BrokerNode, now_ns: int) -> None:
        if POSE in node.core.published.boards:
            pose = Pose.planar(self.now_ns / 1e9, 0.0).pack()
            node.core.published.boards[POSE].put(pose, True, now_ns)

    def take_pose(self, node: BrokerNode, want: BoardSubscription, value: RemoteValue) -> None:
        made_s, key = Pose.unpack(value.payload).x_m, (node.name, want.platform)
        assert made_s >= self.made_s.get(key, 0.0), "an older pose replaced a newer one"
        self.made_s[key] = made_s
        true_stamp_us = (made_s + self.offset_s[want.platform]) * 1e6
        assert abs(value.stamp_us - true_stamp_us) <= 1500, "stamp on the origin's clock"
        age_s = self.now_ns / 1e9 - made_s
        # from 3.2 s on, ages travel in steps of 0.1 s, rounded down at each hop
        assert abs(value.age_us / 1e6 - age_s) <= (0.03 if age_s < 3.2 else 1.5)

    def sent_bytes_all(self) -> int:
        return sum(node.sent_bytes for node in self.brokers.values())

    def fly(self, seconds: float, *, look: bool) -> None:
        """Moves the swarm; `look`: notes the ages of all poses, by distance in good hops."""
        for _ in range(round(seconds * 2)):
            self.run_for(0.5)
            self.place(self.position + self.velocity * 0.5)
            if look:
                self.look()

    def look(self) -> None:
        hops = self.distances()
        for index, name in enumerate(self.names):
            for other, origin in enumerate(self.names):
                if other != index and hops[index][other]:
                    age_s = self.now_ns / 1e9 - self.made_s.get((name, origin), 0.0)
                    self.ages_s[int(hops[index][other])].append(age_s)

    def distances(self) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        """Hops over good links, or 0 if the pair is not connected."""
        count = len(self.names)
        good = self.delivery > 0.85
        reached = np.eye(count, dtype=bool)
        hops = np.zeros((count, count), dtype=np.int64)
        for distance in range(1, count):
            further = (reached.astype(np.uint8) @ good.astype(np.uint8) > 0) & ~reached
            hops[further] = distance
            reached |= further
        return hops
