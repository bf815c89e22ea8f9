"""The owner of a tree with subscribers that acknowledge."""

from tests.unit.tree.pair import S, Tree, core

from swarmd.tree.core.action import Action, RequestStructure, RequestSubscription, SendNotify
from swarmware.model.resource import Kind, Resource
from swarmware.testing.virtual import VirtualSwarm
from swarmware.types import registry
from swarmware.types.tree_exchange import TreeItem, TreeNotify

LIDAR = Resource(path="sensor/lidar", kind=Kind.STREAM, type="Blob", link="notify", owner="hal")


SONAR = Resource(path="sensor/sonar", kind=Kind.STREAM, type="Blob", link="notify", owner="hal")


FAULTS = Resource(path="health/faults", kind=Kind.EVENT, type="Text", owner="health")


BATTERY = Resource(path="power/battery", type="Float", owner="hal")


TEMPLATE = (LIDAR, SONAR, FAULTS, BATTERY)


class Owner:
    """A tree that notifies a subscriber over messages which take their time, get lost, and are repeated."""

    def __init__(self, net: VirtualSwarm[str]) -> None:
        self.net = net
        self.uav = core("uav1", TEMPLATE, templates=(TEMPLATE,))
        self.gcs = core("gcs", TEMPLATE, templates=(TEMPLATE,))
        self.got: dict[str, list[int]] = {}
        self.late_s: list[float] = []
        self.written_ns: dict[tuple[str, int], int] = {}
        self.under_way = self.most_under_way = 0
        self.gcs.on_applications([], ["/uav1/**"], 0)
        for one, other in ((self.gcs, self.uav), (self.uav, self.gcs)):
            one.on_up(other.platform, other.local.version, True, 0)
        for _ in range(4):
            self._settle(self.gcs, self.uav)
            self._settle(self.uav, self.gcs)
        self._driver = net.drive(self.uav.core, self._perform)

    def _settle(self, one: Tree, other: Tree) -> None:
        for action in one.drain():
            match action:
                case RequestStructure(platform, request):
                    one.on_structure(platform, other.on_structure_asked(request, 0), 0)
                case RequestSubscription(platform, subscribe):
                    one.on_subscribed(
                        platform, other.on_subscribe_asked(subscribe, None, 0), subscribe.set_digest, 0
                    )

    def write(self, what: TreeItem) -> None:
        self.written_ns[what.path, what.sequence] = self.net.now_ns
        self._driver.feed(self.uav.core.on_values([what], self.net.now_ns))

    def _perform(self, action: Action) -> None:
        if isinstance(action, SendNotify):
            self.under_way += 1
            self.most_under_way = max(self.most_under_way, self.under_way)
            self._try(action.notify, self.net.now_ns, 0.15, [False])

    def _try(self, notify: TreeNotify, since_ns: int, wait_s: float, done: list[bool]) -> None:
        """As the message router does: again and again until it is acknowledged, or two seconds are over."""
        net = self.net
        if done[0]:
            return
        if net.now_ns - since_ns >= 2 * S:
            self._done(notify, False, done)
            return
        up = net.link("uav1", "gcs")
        if up and net.random.random() >= net.loss:
            net.after(net.random.uniform(*net.delay_s), lambda: self._arrive(notify, done))
        net.after(wait_s, lambda: self._try(notify, since_ns, min(2 * wait_s, 1.0), done))

    def _arrive(self, notify: TreeNotify, done: list[bool]) -> None:
        came = registry.decode(TreeNotify, registry.encode(notify))
        for one in self.gcs.on_notify(came, self.net.now_ns):
            self.got.setdefault(one.path, []).append(one.sequence)
            self.late_s.append((self.net.now_ns - self.written_ns[one.path, one.sequence]) / 1e9)
        if self.net.random.random() >= self.net.loss:
            self.net.after(self.net.random.uniform(*self.net.delay_s), lambda: self._done(notify, True, done))

    def _done(self, notify: TreeNotify, delivered: bool, done: list[bool]) -> None:
        if not done[0]:
            done[0] = True
            self.under_way -= 1
            self._driver.feed(self.uav.core.on_notified("gcs", notify, delivered, self.net.now_ns))
