"""Trees of several units of a platform, connected without a network."""

from tests.unit.tree.pair import S, Tree

from swarmd.tree.core.action import (
    PruneMirrors,
    RemoveMirrors,
    RequestStructure,
    RequestSubscription,
    SendNotify,
    WriteMirror,
)


class Units:
    """Tree cores that reach each other; every message is carried at once."""

    def __init__(self, *trees: Tree) -> None:
        self.trees = {str(tree.address): tree for tree in trees}
        self.now_ns = 0
        self.mirrored: dict[str, list[tuple[str, str, str]]] = {name: [] for name in self.trees}
        """At each node: name of the mirror, path and unit that sent the value."""
        self.removed: dict[str, list[PruneMirrors | RemoveMirrors]] = {name: [] for name in self.trees}

    def meet(self) -> None:
        for name, tree in self.trees.items():
            for other, there in self.trees.items():
                if other != name:
                    tree.on_up(other, there.local.version, True, self.now_ns)
        self.carry()

    def part(self, name: str) -> None:
        for other, tree in self.trees.items():
            if other != name:
                tree.on_gone(name, self.now_ns)
        self.carry()

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * S)
        for tree in self.trees.values():
            tree.on_timer(self.now_ns)
        self.carry()

    def carry(self) -> None:
        while pending := [(name, one) for name, tree in self.trees.items() for one in tree.drain()]:
            for name, action in pending:
                self._carry(name, action)

    def _carry(self, name: str, action: object) -> None:
        tree, now_ns = self.trees[name], self.now_ns
        match action:
            case RequestStructure(to, request):
                tree.on_structure(to, self.trees[to].on_structure_asked(request, now_ns), now_ns)
            case RequestSubscription(to, request):
                reply = self.trees[to].on_subscribe_asked(request, None, now_ns)
                tree.on_subscribed(to, reply, request.set_digest, now_ns)
            case SendNotify(to, notify):
                for one in self.trees[to].core.on_notify(notify, now_ns):
                    if isinstance(one, WriteMirror):
                        self.mirrored[to].append((one.platform, one.item.path, one.unit))
                    else:
                        self._carry(to, one)
                tree.on_notified(to, notify, True, now_ns)
            case PruneMirrors() | RemoveMirrors():
                self.removed[name].append(action)
            case _:
                pass
