"""A link is cut and comes back, in virtual time: when nodes notice it, go around it, and have data again."""

from statistics import median
from typing import Final, NamedTuple

from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.config import Config
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.swarm.links.link import LinkState
from swarmware.model.names import data_id, hardware_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan

SECOND: Final = 1_000_000_000
STEP_S: Final = 0.005
SETTLED_S: Final = 10.0
LONGEST_S: Final = 20.0
CUT_S: Final = 10.0
POSE: Final = data_id("nav/pose", "Pose")
OFFER: Final = TreePlan(1, (BoardPublication("nav/pose", POSE, "Pose"),))
WANT: Final = TreePlan(1, wants=(BoardSubscription("uav2", "nav/pose", "Pose", POSE),))


class Outage(NamedTuple):
    """Times of one outage, in seconds."""

    noticed: float
    """From the cut until the other end counts as lost."""
    rerouted: float
    """From the cut until frames go around it, over the third node."""
    data_back: float
    """From the end of the cut until the first direct board value of the other end, or 0 if it sends none."""
    frames_back: float
    """From the end of the cut until frames may go directly again."""


def write_pose(node: BrokerNode, now_ns: int) -> None:
    """Every beacon has a new pose."""
    board = node.core.published.boards.get(POSE)
    if board is not None:
        board.put(now_ns.to_bytes(25, "little"), True, now_ns)


class Triangle(VirtualSwarm[str]):
    """uav1, uav2 and uav3 in range of each other; the link between the first two may lose more, or all."""

    def __init__(self, seed: int, *, loss: float = 0.0, third: bool = True, busy: bool = True) -> None:
        """`busy`: whether uav1 subscribes to the pose of uav2, which then sends at 10 Hz; else all idle."""
        super().__init__(seed, loss=loss, delay_s=(0.001, 0.005))
        self.busy = busy
        self.direct_loss = 0.0
        """Of the link between uav1 and uav2, beside the loss of all links."""
        self.link = lambda sender, receiver: {sender, receiver} != {"uav1", "uav2"} or self.passes()
        self.values: list[int] = []
        """Instants at which uav1 took a value of uav2; nobody relays any."""
        names = ["uav1", "uav2", "uav3"] if third else ["uav1", "uav2"]
        self.brokers = {
            name: BrokerNode(
                self,
                name,
                VirtualClock(self),
                config=Config(relay_bytes_s=0.0),
                write_boards=write_pose,
                on_value=self._on_value,
            )
            for name in names
        }
        if busy:
            self.brokers["uav2"].driver.feed(self.brokers["uav2"].core.on_plan(OFFER, 0))
            self.brokers["uav1"].driver.feed(self.brokers["uav1"].core.on_plan(WANT, 0))

    def passes(self) -> bool:
        """Whether the link between uav1 and uav2 delivers a datagram; a random number only where it needs
        one."""
        return self.direct_loss == 0.0 or (
            self.direct_loss < 1.0 and self.random.random() >= self.direct_loss
        )

    def _on_value(self, node: BrokerNode, _: BoardSubscription, _value: RemoteValue) -> None:
        if node.name == "uav1":
            self.values.append(self.now_ns)

    def via(self, name: str = "uav1", goal: str = "uav2") -> str:
        """Next hop of a node to another node, or "" without a route."""
        routes = self.brokers[name].core.report.routes().routes
        return next((route.via for route in routes if route.platform == goal), "")

    def is_up(self) -> bool:
        """Whether uav1 counts uav2 as a neighbour."""
        return self.brokers["uav1"].link_states.get(hardware_id("uav2")) is LinkState.UP

    def outage(self) -> Outage:
        """Cuts the link, waits, and heals it."""
        self.run_for(SETTLED_S + self.random.random())
        assert self.is_up()
        self.direct_loss = 1.0
        cut_ns = self.now_ns
        noticed = rerouted = 0.0
        has_third = "uav3" in self.brokers
        while not noticed or (has_third and not rerouted):
            self.run_for(STEP_S)
            since_s = (self.now_ns - cut_ns) / SECOND
            noticed = noticed or (0.0 if self.is_up() else since_s)
            rerouted = rerouted or (since_s if self.via() == "uav3" else 0.0)
            assert since_s < LONGEST_S
        self.run_for(CUT_S)
        self.direct_loss = 0.0
        healed_ns, self.values[:] = self.now_ns, []
        frames_back = 0.0
        while not (frames_back and (self.values or not self.busy)):
            self.run_for(STEP_S)
            since_s = (self.now_ns - healed_ns) / SECOND
            frames_back = frames_back or (since_s if self.is_up() and self.via() else 0.0)
            assert since_s < LONGEST_S
        data_back = (self.values[0] - healed_ns) / SECOND if self.busy else 0.0
        return Outage(noticed, rerouted, data_back, frames_back)


def outages(seeds: range, *, loss: float = 0.0, third: bool = True, busy: bool = True) -> list[Outage]:
    """One outage for each seed."""
    return [Triangle(seed, loss=loss, third=third, busy=busy).outage() for seed in seeds]


def middle(found: list[Outage]) -> Outage:
    """The median of each time."""
    return Outage(*(median(times) for times in zip(*found, strict=True)))


def worst(found: list[Outage]) -> Outage:
    """The longest of each time."""
    return Outage(*(max(times) for times in zip(*found, strict=True)))
