"""The computers of each platform: which of them provides a resource, and where its values are mirrored."""

import logging
from collections.abc import Iterable, Iterator

from swarmd.tree.core.action import PruneMirrors, RemoveMirrors
from swarmd.tree.core.replicas.replica import Replica
from swarmd.tree.core.structure.index import Index, Leaf, pattern
from swarmd.tree.core.structure.local import LocalTree
from swarmd.tree.core.structure.subscription import subscribable
from swarmware.model import names
from swarmware.model.names import MAIN, Address
from swarmware.model.resource import Kind, Resource
from swarmware.types.net import BoardSubscription

log = logging.getLogger("swarm.tree")


def ambiguous(index: Index, wanted: Iterable[Resource]) -> set[str]:
    """Paths of wanted boards whose number another resource of the same computer has."""
    numbers = {resource.data_id: resource.path for resource in wanted}
    found = {
        path
        for item in index
        if item.resource.kind is not Kind.BRANCH
        and (path := numbers.get(item.resource.data_id)) is not None
        and path != item.resource.path
    }
    return found | {one.path for one in wanted if numbers[one.data_id] != one.path}


class PlatformUnits:
    """Merges the trees of the computers of a platform: a path belongs to the first computer that provides it.

    Order: this computer, computers whose application runs, reachable computers, `main`.
    """

    def __init__(self, own: Address, tree: LocalTree) -> None:
        self._own = own
        self._tree = tree
        self._by_platform: dict[str, list[Replica]] = {}
        self._sent: set[tuple[str, str]] = set()
        """Pairs of computer and path with a received value: not only the computer's template has the path."""

    # -- the computers

    def add(self, replica: Replica) -> None:
        """A computer is known."""
        units = self._by_platform.setdefault(replica.address.platform, [])
        units.append(replica)
        # `main` first: it has the template, which decides where nothing else does
        units.sort(key=lambda unit: (unit.address.unit != MAIN, names.natural(unit.name)))

    def remove(self, replica: Replica) -> list[PruneMirrors | RemoveMirrors]:
        """A computer is not known any more: its mirrors are to be removed."""
        platform = replica.address.platform
        units = self._by_platform[platform]
        units.remove(replica)
        self._forget_sent(replica)
        actions: list[PruneMirrors | RemoveMirrors] = []
        if replica.address.unit != MAIN:
            actions.append(RemoveMirrors(replica.address.path))
        if units:
            return actions + self._prune_platform(platform)
        del self._by_platform[platform]
        return [RemoveMirrors(platform), *actions]

    def _forget_sent(self, replica: Replica) -> None:
        self._sent = {one for one in self._sent if one[0] != replica.name}

    def platforms(self) -> list[str]:
        """Every other platform that is known."""
        return [platform for platform in self._by_platform if platform != self._own.platform]

    def of(self, platform: str) -> list[Replica]:
        """The known computers of a platform, except this one; `main` first."""
        return self._by_platform.get(platform, [])

    # -- their resources

    def provider(self, platform: str, path: str) -> Replica | None:
        """The computer that provides a path of a platform, or None if this one or no known one does."""
        units = self.of(platform)
        if platform == self._own.platform:
            if self._tree.holds(path):
                return None
        # most platforms have one computer: no search for the best
        elif len(units) == 1:
            return units[0]
        best: tuple[bool, bool, bool] | None = None
        found = None
        for unit in units:
            item = None if unit.index is None else unit.index.get(path)
            if item is None:
                continue
            rank = (item.lost, not unit.up, unit.address.unit != MAIN)
            if best is None or rank < best:
                best, found = rank, unit
        return found

    def leaf(self, platform: str, path: str) -> tuple[Replica | None, Leaf] | None:
        """A resource of a platform with its computer (None for this one), or None if unknown."""
        unit = self.provider(platform, path)
        index = self._tree.index if unit is None and platform == self._own.platform else None
        if unit is not None:
            index = unit.index
        item = None if index is None else index.get(path)
        return None if item is None else (unit, item)

    def provided(self) -> set[str]:
        """Paths that the other computers of this platform provide."""
        return {
            item.resource.path
            for unit in self.of(self._own.platform)
            if unit.index is not None
            for item in unit.index
            if not item.lost
        }

    # -- their values

    def mirrors(self, replica: Replica, path: str) -> Iterator[str]:
        """Names under which a value of a computer is mirrored: of its platform, and its own."""
        platform = replica.address.platform
        if any(pattern(text).matches(path) for text in replica.platform_patterns):
            own = platform == self._own.platform and self._tree.holds(path)
            provider = None if own else self.provider(platform, path)
            if replica.index is not None and path in replica.index:
                self._sent.add((replica.name, path))
            # a value may arrive before the structures that show who provides it, and it is not sent again
            others = provider is not None and (provider.name, path) in self._sent
            if not own and (provider is replica or not others):
                yield platform
        if any(pattern(text).matches(path) for text in replica.computer_patterns):
            yield replica.address.path

    def update_wants(self, platform: str) -> bool:
        """Match a platform's structures and subscriptions; True if the wanted beacon values changed."""
        if platform == self._own.platform:
            return False  # this platform's values are notified
        units = self.of(platform)
        digests = tuple(unit.digest for unit in units)
        changed = False
        for unit in units:
            matched = (*digests, unit.subscription.wanted.digest)
            if matched != unit.matched:
                unit.matched = matched
                before, unit.wants = unit.wants, self._wants(unit)
                changed |= unit.wants != before
        return changed

    def _wants(self, unit: Replica) -> tuple[BoardSubscription, ...]:
        wanted, index = unit.subscription.wanted, unit.index
        found = {
            item.resource.path: item.resource
            for text in wanted.patterns
            for item in (() if index is None else index.match(text))
            if item.resource.link == "tick" and subscribable(item, wanted.patterns)
        }
        # a beacon names a board by its number alone, so values of one board would count as the other's
        for path in () if index is None else ambiguous(index, found.values()):
            log.error("%s of %s: not received: another path there has its number in frames", path, unit.name)
            del found[path]
        return tuple(
            BoardSubscription(name, path, found[path].type, found[path].data_id, unit.address.unit)
            for path in sorted(found)
            for name in self.mirrors(unit, path)
        )

    def prune(self, replica: Replica) -> list[PruneMirrors | RemoveMirrors]:
        """Resources of a computer were removed: the mirrors that stay."""
        self._forget_sent(replica)
        actions = self._prune_platform(replica.address.platform)
        if replica.computer_patterns and replica.index is not None:
            kept = frozenset(item.resource.path for item in replica.index)
            actions.append(PruneMirrors(replica.address.path, kept))
        return actions

    def prune_own(self) -> list[PruneMirrors | RemoveMirrors]:
        """Applications of this computer have joined or left: mirrors of what they provide are removed."""
        return self._prune_platform(self._own.platform)

    def _prune_platform(self, platform: str) -> list[PruneMirrors | RemoveMirrors]:
        kept: set[str] = set()
        for unit in self.of(platform):
            if unit.index is None:
                return []  # its mirrors of a former start may be valid
            kept.update(item.resource.path for item in unit.index)
        if platform == self._own.platform:
            kept = {path for path in kept if not self._tree.holds(path)}
        return [PruneMirrors(platform, frozenset(kept))]
