"""A boot storm: all nodes of a cell start within a second, and may subscribe to the poses of all others."""

from typing import Final

from tests.simulation.directory.brokers import BrokerNode, SimulatedKeys
from tests.simulation.directory.cell import OFFERS, POSE, SECOND, pose_made_at

from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.swarm.links.link import LinkState
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import BoardSubscription, TreePlan

DELAY_S: Final = (0.001, 0.02)
STEP_S: Final = 0.05
LIMIT_S: Final = 60.0


class Storm(VirtualSwarm[str]):
    """The nodes, and whose poses each of them has."""

    def __init__(self, seed: int, count: int, *, loss: float, subscribed: bool = True) -> None:
        super().__init__(seed, loss=loss, delay_s=DELAY_S)
        self.names = [f"uav{index + 1}" for index in range(count)]
        self.subscribed = subscribed
        self.started: dict[str, BrokerNode] = {}
        self.poses: set[tuple[str, str]] = set()
        """By receiver and origin: a pose has arrived."""
        for name in self.names:
            self.at(self.random.randrange(SECOND), lambda name=name: self.start(name))  # type: ignore[misc]  # the name of this iteration

    def start(self, name: str) -> None:
        """Starts a broker."""
        node = BrokerNode(
            self,
            name,
            VirtualClock(self),
            write_boards=self.write_pose,
            on_value=self.take_pose,
            signing=SimulatedKeys(name),
        )
        self.started[name] = node
        if not self.subscribed:
            return
        others = (other for other in self.names if other != name)
        wants = tuple(BoardSubscription(other, "nav/pose", "Pose", POSE) for other in others)
        node.driver.feed(node.core.on_plan(TreePlan(1, OFFERS, wants), self.now_ns))

    def write_pose(self, node: BrokerNode, now_ns: int) -> None:
        if POSE in node.core.published.boards:
            node.core.published.boards[POSE].put(pose_made_at(now_ns), True, now_ns)

    def take_pose(self, node: BrokerNode, want: BoardSubscription, value: RemoteValue) -> None:
        self.poses.add((node.name, want.platform))

    def is_complete(self) -> bool:
        """Whether each node has a link and a route to each other one, its name and its pose."""
        others = len(self.names) - 1
        return len(self.poses) == len(self.names) * others and all(
            sum(state is LinkState.UP for state in node.link_states.values()) == others
            and {route.platform for route in node.core.report.routes().routes} >= {*self.names} - {name}
            for name, node in self.started.items()
        )

    def converge_s(self) -> float:
        """Time from the first start until the swarm is complete.

        Raises: AssertionError when that takes longer than LIMIT_S.
        """
        while not self.is_complete():
            self.run_for(STEP_S)
            assert self.now_ns < LIMIT_S * SECOND, f"seed {self.seed}: not complete after {LIMIT_S} s"
        return self.now_ns / SECOND
