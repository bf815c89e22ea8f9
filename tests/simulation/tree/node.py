"""One platform of the simulated swarm: its real tree core, the values it has, the mirrors it holds."""

from collections.abc import Callable
from functools import partial
from typing import Protocol

import msgspec

from swarmd.tree.config import Config
from swarmd.tree.core.action import (
    Action,
    RequestStructure,
    RequestSubscription,
    SendNotify,
    Unwatch,
    Watch,
    WriteMirror,
)
from swarmd.tree.core.tree import SwarmTree
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.node.mirror_writer import ArrivalOrder
from swarmware.runtime.driver import CoreDriver
from swarmware.types.tree_exchange import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)

S = 1_000_000_000
CONFIG = Config(
    lost_s=1.0,
    expire_s=10.0,
    coalesce_s=0.2,
    min_interval_s=0.1,
    lease_s=40.0,
    retry_s=(0.5, 1.0, 2.0, 4.0),
    forget_s=300.0,
)
TEMPLATE = (
    Resource(path="power/battery", type="Float", owner="hal"),
    Resource(path="health/faults", kind=Kind.EVENT, type="Text", owner="health"),
    Resource(path="mission/state", type="Text", rate_hz=5.0, owner="mission"),
    Resource(path="nav/pose", type="Pose", rate_hz=20.0, owner="navigator"),
    Resource(path="sys/tree/get", kind=Kind.COMMAND, type="TreeGet", owner="tree"),
)
OTHER = (*TEMPLATE[:4], Resource(path="sensor/sonar", type="Range", rate_hz=20.0, owner="hal"))


class Network(Protocol):
    """What a node needs of the swarm."""

    now_ns: int

    def new_epoch(self) -> int:
        """A random number."""
        ...

    def drive(
        self, core: SwarmTree, perform: Callable[[Action], None], *, settled: Callable[[], None]
    ) -> CoreDriver[Action]:
        """See VirtualTime."""
        ...

    def on_started(self, tree: SwarmTree) -> None:
        """The broker of the node has the plan of this tree from now on."""
        ...

    def on_settled(self, name: str) -> None:
        """The plan of the tree of a node may have changed."""
        ...

    def on_stopped(self, name: str) -> None:
        """The broker of a node has ended."""
        ...

    def ask_structure(self, one: "Node", platform: str, request: StructureRequest) -> None:
        """Carry a request; the answer comes by `on_structure`."""
        ...

    def ask_subscription(self, one: "Node", platform: str, request: SubscribeRequest) -> None:
        """Carry a request; the answer comes by `on_subscribed`."""
        ...

    def notify(self, one: "Node", platform: str, notify: TreeNotify) -> None:
        """Carry a message; what became of it comes by `on_notified`."""
        ...


class Node:
    """Starts, stops, reads and writes like a platform."""

    def __init__(self, network: Network, number: int, *, whole_swarm: bool) -> None:
        self.name = f"n{number}"
        self.modules: set[int] = set()
        self.patterns: tuple[str, ...] = ()
        self.values: dict[str, TreeItem] = {}
        self.mirrors: dict[tuple[str, str], TreeItem] = {}
        self.events: dict[tuple[str, int], list[int]] = {}
        """Platform and start of its tree → sequences of the events that came."""
        self.tree: SwarmTree | None = None
        self.life = 0
        self.seen: tuple[dict[str, None], dict[str, int]] = ({}, {})
        """Neighbours, and everybody's version, as it was told last."""
        self._network = network
        self._template = TEMPLATE if number % 3 else OTHER
        self._config = msgspec.structs.replace(CONFIG, whole_swarm=whole_swarm)
        self._watched: set[str] = set()
        self._driver: CoreDriver[Action] | None = None
        self._orders: dict[tuple[str, str], ArrivalOrder] = {}

    # -- its life

    def start(self) -> None:
        """The tree service starts, for the first time or again; one half of the templates must be learnt."""
        self.life += 1
        tree = self.tree = SwarmTree(
            self.name,
            self._template,
            self._config,
            epoch=self._network.new_epoch(),
            templates=(TEMPLATE,),
        )
        self._watched = set()
        self._orders = {}
        self.seen = ({}, {})
        if self._driver is not None:
            self._driver.stop()
        self._driver = self._network.drive(
            tree, partial(self._carry_out, tree), settled=partial(self._network.on_settled, self.name)
        )
        self._network.on_started(tree)
        self.update()

    def stop(self) -> None:
        """The node dies; memory and mirrors go with it."""
        self.life += 1
        self.tree = None
        if self._driver is not None:
            self._driver.stop()
        self._network.on_stopped(self.name)
        self.mirrors.clear()
        self.events.clear()

    def start_again(self) -> None:
        """The tree service of a living node starts again."""
        if self.tree is not None:
            self.start()

    def run_module(self, number: int, runs: bool) -> None:
        """A functional module comes or goes."""
        if runs:
            self.modules.add(number)
            self.write(f"plan/step{number}", f"first of {number}")
        else:
            self.modules.discard(number)
        self.update()

    def update(self) -> None:
        """What its applications provide and read has changed."""
        if self.tree is not None:
            provided = [
                Resource(path=f"plan/step{module}", type="Text", owner=f"planner{module}")
                for module in sorted(self.modules)
            ]
            self.do(partial(self.tree.on_applications, provided, self.patterns, self._network.now_ns))

    def write(self, path: str, text: str, kind: FrameKind = FrameKind.BOARD) -> None:
        """An application writes a value."""
        before = self.values.get(path)
        sequence = 1 if before is None else before.sequence + 1
        item = TreeItem(path, 7, kind, sequence, self._network.now_ns, text.encode())
        self.values[path] = item
        if self.tree is not None and path in self._watched:
            self.do(partial(self.tree.on_values, [item], self._network.now_ns))

    def receive(self, notify: TreeNotify) -> None:
        """A notification came."""
        tree = self.tree
        assert tree is not None
        self.do(partial(tree.on_notify, notify, self._network.now_ns))

    def _write_mirror(self, platform: str, item: TreeItem, epoch: int) -> None:
        position = (epoch, item.sequence, item.stamp_ns)
        if item.kind == FrameKind.EVENT:
            last = self.mirrors.get((platform, item.path))
            resumed = None if last is None else (last.sequence, last.stamp_ns)
            order = self._orders.setdefault((platform, item.path), ArrivalOrder(resumed))
            if order.is_late(*position):
                return
            order.on_written(*position)
            self.events.setdefault((platform, epoch), []).append(item.sequence)
        self.mirrors[platform, item.path] = item

    # -- the shell

    def do(self, call: Callable[[], list[Action]]) -> None:
        """Feed the core; its driver carries out what it wants."""
        actions = call()
        if self._driver is not None:
            self._driver.feed(actions)

    def _carry_out(self, tree: SwarmTree, action: Action) -> None:
        match action:
            case Watch(resource):
                self._watched.add(resource.path)
                value = self.values.get(resource.path)
                if value is not None and resource.kind is Kind.BOARD:
                    self.do(partial(tree.on_values, [value], self._network.now_ns))
            case WriteMirror(platform, item, epoch):
                self._write_mirror(platform, item, epoch)
            case Unwatch(path):
                self._watched.discard(path)
            case RequestStructure(platform, request):
                self._network.ask_structure(self, platform, request)
            case RequestSubscription(platform, request):
                self._network.ask_subscription(self, platform, request)
            case SendNotify(platform, notify):
                self._network.notify(self, platform, notify)

    def on_structure(self, platform: str, reply: StructureReply | None) -> None:
        """Takes the reply, or None if the platform did not answer."""
        if self.tree is not None:
            self.do(partial(self.tree.on_structure, platform, reply, self._network.now_ns))

    def on_subscribed(self, platform: str, reply: SubscribeReply | None, asked: int) -> None:
        """Takes the reply, or None if the platform did not answer."""
        if self.tree is not None:
            self.do(partial(self.tree.on_subscribed, platform, reply, asked, self._network.now_ns))

    def on_notified(self, platform: str, notify: TreeNotify, delivered: bool) -> None:
        """What became of a notification."""
        if self.tree is not None:
            self.do(partial(self.tree.on_notified, platform, notify, delivered, self._network.now_ns))
