"""Resources of all platforms as known to this node: descriptors, newest values, ages, qualities."""

from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from swarmd.tree.core.quality import quality
from swarmd.tree.core.rate import measured_hz
from swarmd.tree.core.structure.index import Index, Leaf
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.taps import Peek
from swarmware.errors import NotFound, SwarmError
from swarmware.model import names
from swarmware.model.frame import Frame
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind, Resource
from swarmware.types import registry
from swarmware.types.tree import Quality, TreeEntry, TreePlatform, TreeValue, ValueSource

_VALUELESS: Final = frozenset({Kind.BRANCH, Kind.COMMAND, Kind.FILE})


class TreeView:
    """Reads the tree, the rings and the mirrors of this node; asks no other one."""

    def __init__(
        self,
        tree: SwarmTree,
        peek: Peek,
        now_ns: Callable[[], int],
        to_local_ns: Callable[[int, int], int | None],
    ) -> None:
        """`to_local_ns`: converts a stamp of another unit's clock; None: that clock is unknown."""
        self._tree = tree
        self._peek = peek
        self._now_ns = now_ns
        self._to_local_ns = to_local_ns
        self._own = tree.platform

    # -- platforms

    def platforms(self) -> list[str]:
        """All known platforms in natural order."""
        return sorted({self._own, *self._tree.replicas.platforms()}, key=names.natural)

    def platform(self, platform: str) -> TreePlatform:
        """State of the replica of one platform's tree."""
        index = self._index(platform)
        size, digest = (0, 0) if index is None else (len(index), index.digest)
        followed = platform == self._own or self._tree.replicas.follows(platform)
        return TreePlatform(platform, self.is_reachable(platform), size, digest, followed)

    def is_reachable(self, platform: str) -> bool:
        """Whether it is this platform, or one with a route."""
        replica = self._tree.replicas.get(platform)
        return platform == self._own or (replica is not None and replica.up)

    def check_platform(self, platform: str) -> None:
        """Raises: NotFound for an unknown platform, with the known ones."""
        if self._tree.replicas.get(platform) is None:
            known = ", ".join(self.platforms())
            raise NotFound(f"platform {platform!r}: not known to {self._own}; expected one of {known}")

    def _index(self, platform: str) -> Index | None:
        if platform == self._own:
            return self._tree.local.index
        replica = self._tree.replicas.get(platform)
        return None if replica is None else replica.index

    # -- resources

    def own_leaf(self, local: str) -> Leaf:
        """A resource of this platform. Raises: NotFound with similar paths."""
        index = self._tree.local.index
        found = index.get(local)
        if found is None:
            near = ", ".join(names.join(self._own, path) for path in index.near(local))
            if local.partition("/")[0] in self.platforms():
                near = f"/{local}"  # the slash before the platform was forgotten
            hint = f"did you mean {near}?" if near else "expected a path that `swarmctl tree ls` shows"
            raise NotFound(f"{names.join(self._own, local)}: no such resource; {hint}")
        return found

    def matching(self, wanted: Pattern, rest: str, after: str) -> Iterator[tuple[str, Leaf]]:
        """Platform and leaf of the resources that match, behind the path `after`. Raises: InvalidInput."""
        last, last_local = names.split(after) if after else (None, "")
        for platform in self.platforms():
            index = self._index(platform)
            if index is None or not wanted.matches(platform):
                continue
            if last is not None and names.natural(platform) < names.natural(last):
                continue
            for leaf in index.match(rest, after=last_local if platform == last else ""):
                yield platform, leaf

    def entry(self, platform: str, leaf: Leaf) -> TreeEntry:
        """A resource with age and quality of its value at this node."""
        resource = leaf.resource
        frame = None
        if resource.kind not in _VALUELESS:
            frame = self._frame(platform, resource.path)
        age_s = None if frame is None else self._age_s(platform, frame)
        quality = self._quality(platform, leaf, age_s, known=frame is not None)
        measured = self._measured_hz(platform, resource, frame, age_s)
        rule = self._tree.subscribers.rule_of(resource.path) if platform == self._own else None
        return TreeEntry.of(resource, names.join(platform, resource.path), age_s, quality, measured, rule)

    # -- values

    def own_value(self, leaf: Leaf, version: int | None) -> TreeValue:
        """The newest value of a resource of this platform; `version`: of a setting.

        Raises: NotFound if there is none.
        """
        resource = leaf.resource
        path = names.join(self._own, resource.path)
        if resource.kind in _VALUELESS:
            raise NotFound(
                f"{path}: a {resource.kind} has no value; expected a board, event, stream or setting"
            )
        frame = self._peek.frame(resource.path)
        if frame is None:
            raise NotFound(f"{path}: no value yet; expected one from {resource.owner or 'its provider'}")
        return self._value(self._own, leaf, frame, ValueSource.OWN, version)

    def mirrored_value(self, platform: str, local: str) -> TreeValue | None:
        """The mirrored value, if it is kept up to date or the only one available."""
        replica = self._tree.replicas.get(platform)
        leaf = None if replica is None or replica.index is None else replica.index.get(local)
        if replica is None or leaf is None:
            return None
        if replica.up and not replica.receives(leaf):
            return None  # left from a former subscription
        frame = self._peek.frame(local, platform)
        return None if frame is None else self._value(platform, leaf, frame, ValueSource.MIRROR, None)

    def own_frame(self, resource: Resource) -> Frame | None:
        """The newest frame of a resource of this platform."""
        return None if resource.kind in _VALUELESS else self._peek.frame(resource.path)

    def own_text(self, resource: Resource) -> str:
        """The newest value of a resource of this platform as JSON; empty: there is none."""
        frame = self.own_frame(resource)
        if frame is None:
            return ""
        try:
            return json_text(registry.messagepack(resource.type, frame.payload, frame.codec))
        except SwarmError:
            return ""

    def _frame(self, platform: str, local: str) -> Frame | None:
        return self._peek.frame(local, None if platform == self._own else platform)

    def _value(
        self, platform: str, leaf: Leaf, frame: Frame, source: ValueSource, version: int | None
    ) -> TreeValue:
        resource = leaf.resource
        age_s = self._age_s(platform, frame)
        return TreeValue(
            names.join(platform, resource.path),
            resource.type,
            registry.messagepack(resource.type, frame.payload, frame.codec),
            frame.stamp_ns,
            frame.sequence,
            frame.sequence if version is None else version,
            age_s,
            self._quality(platform, leaf, age_s, known=True),
            resource.unit,
            resource.owner,
            source,
            self._measured_hz(platform, resource, frame, age_s),
        )

    def _measured_hz(
        self, platform: str, resource: Resource, frame: Frame | None, age_s: float | None
    ) -> float | None:
        if frame is None or (platform != self._own and resource.link == "tick"):
            return None  # the beacon carries no numbers of the owner
        older = self._peek.older(resource.path, None if platform == self._own else platform)
        if older is None or older.sender_hw != frame.sender_hw:
            return None
        span_s = (frame.stamp_ns - older.stamp_ns) / 1e9
        return measured_hz(frame.sequence - older.sequence, span_s, age_s)

    def _age_s(self, platform: str, frame: Frame) -> float | None:
        now_ns = self._now_ns()
        if platform == self._own:
            return (now_ns - frame.stamp_ns) / 1e9
        stamp_ns = self._to_local_ns(frame.sender_hw, frame.stamp_ns)
        if stamp_ns is not None:
            return (now_ns - stamp_ns) / 1e9
        replica = self._tree.replicas.get(platform)
        # its clock is unknown: the value is at least as old as the loss
        return None if replica is None or replica.up else (now_ns - replica.gone_ns) / 1e9

    def _quality(self, platform: str, leaf: Leaf, age_s: float | None, *, known: bool) -> Quality:
        replica = self._tree.replicas.get(platform)
        return quality(
            leaf,
            age_s,
            reachable=self.is_reachable(platform),
            known=known,
            mirrored=platform != self._own,
            interval_s=0.0 if replica is None else replica.interval_s(leaf.resource.path),
        )


def json_text(data: bytes) -> str:
    """MessagePack as JSON text, for display."""
    return msgspec.json.encode(msgspec.msgpack.decode(data)).decode()
