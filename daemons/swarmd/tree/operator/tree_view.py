"""Resources of all platforms as known to this node: descriptors, newest values, ages, qualities."""

from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from swarmd.tree.core.replicas.replica import Replica
from swarmd.tree.core.structure.index import HINTS, Index, Leaf
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.values.quality import measured_hz, quality
from swarmd.tree.exchange.taps import Peek
from swarmware.errors import NotFound, SwarmError
from swarmware.model import names
from swarmware.model.frame import Frame
from swarmware.model.names import Address, Pattern
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
        """`to_local_ns`: converts a stamp of another unit's clock; returns None if that clock is unknown."""
        self._tree = tree
        self._peek = peek
        self._now_ns = now_ns
        self._to_local_ns = to_local_ns
        self._own = tree.platform
        self._units = tree.replicas.units

    # -- platforms

    def platforms(self) -> list[str]:
        """All known platforms in natural order."""
        return sorted({self._own, *self._units.platforms()}, key=names.natural)

    def platform(self, platform: str) -> TreePlatform:
        """State of the tree of one platform: of its unit `main`, or of its first known unit."""
        size, digest = 0, 0
        for index in self._indexes(platform)[:1]:
            size, digest = len(index), index.digest
        units = self._units.of(platform)
        followed = platform == self._own or any(self._tree.replicas.follows(unit.name) for unit in units)
        return TreePlatform(platform, self.is_reachable(platform), size, digest, followed)

    def is_reachable(self, platform: str) -> bool:
        """Whether it is this platform, or one with a route to one of its computers."""
        return platform == self._own or any(unit.up for unit in self._units_named(platform))

    def check_platform(self, platform: str) -> None:
        """Raises: NotFound for an unknown platform, with the known ones."""
        if not self._units_named(platform):
            known = ", ".join(self.platforms())
            raise NotFound(f"platform {platform!r}: not known to {self._own}; expected one of {known}")

    def _units_named(self, name: str) -> list[Replica]:
        """The computers of a platform, or the one of this name."""
        if "." not in name:
            return self._units.of(name)
        unit = self._tree.replicas.get(str(Address.parse(name)))
        return [] if unit is None else [unit]

    def _indexes(self, platform: str) -> list[Index]:
        found = [unit.index for unit in self._units.of(platform) if unit.index is not None]
        return [self._tree.local.index, *found] if platform == self._own else found

    # -- resources

    def find(self, name: str, local: str) -> tuple[Replica | None, Leaf] | None:
        """A resource of a platform or computer, and the computer that provides it, or None for this one."""
        if name == self._tree.address.path:
            item = self._tree.local.index.get(local)
            return None if item is None else (None, item)
        if "." not in name:
            return self._units.leaf(name, local)
        for unit in self._units_named(name):
            if unit.index is not None and (item := unit.index.get(local)) is not None:
                return unit, item
        return None

    def own_leaf(self, local: str) -> Leaf:
        """A resource of this computer. Raises: NotFound with similar paths."""
        found = self._tree.local.index.get(local)
        if found is None:
            near = ", ".join(names.join(self._own, path) for path in self._near(local))
            if local.partition("/")[0] in self.platforms():
                near = f"/{local}"  # the slash before the platform was forgotten
            hint = f"did you mean {near}?" if near else "expected a path that `swarmctl tree ls` shows"
            raise NotFound(f"{names.join(self._own, local)}: no such resource; {hint}")
        return found

    def _near(self, local: str) -> list[str]:
        found = dict.fromkeys(path for index in self._indexes(self._own) for path in index.near(local))
        return list(found)[:HINTS]

    def matching(self, wanted: Pattern, rest: str, after: str) -> Iterator[tuple[str, list[Leaf]]]:
        """The resources that match, by name, behind the path `after`. Raises: InvalidInput.

        A name is a platform's, or a computer's where the pattern has a point.
        """
        last, last_local = names.split(after) if after else (None, "")
        for name in self._computers() if wanted.names_unit else self.platforms():
            if not wanted.matches(name):
                continue
            if last is not None and names.natural(name) < names.natural(last):
                continue
            yield name, self._matching(name, rest, last_local if name == last else "")

    def _computers(self) -> list[str]:
        found = {Address.parse(name).path for name in self._tree.replicas.platforms()}
        return sorted({self._tree.address.path, *found}, key=names.natural)

    def _matching(self, name: str, rest: str, after: str) -> list[Leaf]:
        if name == self._tree.address.path:
            return self._tree.local.index.match(rest, after=after)
        if "." in name:
            indexes = [unit.index for unit in self._units_named(name) if unit.index is not None]
        else:
            indexes = self._indexes(name)
        if len(indexes) == 1:
            return indexes[0].match(rest, after=after)
        found = {leaf.resource.path for index in indexes for leaf in index.match(rest, after=after)}
        places = (self._units.leaf(name, path) for path in sorted(found))
        return [place[1] for place in places if place is not None]

    def entry(self, name: str, leaf: Leaf) -> TreeEntry:
        """A resource of a platform or computer with age and quality of its value at this node."""
        resource = leaf.resource
        place = self.find(name, resource.path)
        unit = None if place is None else place[0]
        frame = None
        if resource.kind not in _VALUELESS:
            frame = self._peek.frame(resource.path, None if unit is None else name)
        age_s = None if frame is None else self._age_s(unit, frame)
        quality = self._quality(unit, leaf, age_s, known=frame is not None)
        measured = self._measured_hz(unit, name, resource, frame, age_s)
        rule = self._tree.subscribers.rule_of(resource.path) if unit is None else None
        return TreeEntry.of(resource, names.join(name, resource.path), age_s, quality, measured, rule)

    # -- values

    def own_value(self, leaf: Leaf, version: int | None) -> TreeValue:
        """The newest value of a resource of this platform; `version`: of a setting.

        Raises: NotFound without a value.
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
        return self._value(None, self._own, leaf, frame, ValueSource.OWN, version)

    def mirrored_value(self, name: str, local: str) -> TreeValue | None:
        """The mirrored value of a platform or computer, if it is kept up to date or the only one."""
        unit, leaf = self.find(name, local) or (None, None)
        if unit is None or leaf is None:
            return None
        if unit.up and not unit.receives(leaf):
            return None  # left from a former subscription
        frame = self._peek.frame(local, name)
        return None if frame is None else self._value(unit, name, leaf, frame, ValueSource.MIRROR, None)

    def own_frame(self, resource: Resource) -> Frame | None:
        """The newest frame of a resource of this platform."""
        return None if resource.kind in _VALUELESS else self._peek.frame(resource.path)

    def own_text(self, resource: Resource) -> str:
        """The newest value of a resource of this platform as JSON, or "" without a value."""
        frame = self.own_frame(resource)
        if frame is None:
            return ""
        try:
            return json_text(registry.messagepack(resource.type, frame.payload, frame.codec))
        except SwarmError:
            return ""

    def _value(
        self,
        unit: Replica | None,
        name: str,
        leaf: Leaf,
        frame: Frame,
        source: ValueSource,
        version: int | None,
    ) -> TreeValue:
        resource = leaf.resource
        age_s = self._age_s(unit, frame)
        return TreeValue(
            names.join(name, resource.path),
            resource.type,
            registry.messagepack(resource.type, frame.payload, frame.codec),
            frame.stamp_ns,
            frame.sequence,
            frame.sequence if version is None else version,
            age_s,
            self._quality(unit, leaf, age_s, known=True),
            resource.unit,
            resource.owner,
            source,
            self._measured_hz(unit, name, resource, frame, age_s),
        )

    def _measured_hz(
        self, unit: Replica | None, name: str, resource: Resource, frame: Frame | None, age_s: float | None
    ) -> float | None:
        if frame is None or (name != self._own and unit is not None and resource.link == "tick"):
            return None  # the beacon carries no numbers of the owner
        older = self._peek.older(resource.path, None if unit is None else name)
        if older is None or older.sender_hw != frame.sender_hw:
            return None
        span_s = (frame.stamp_ns - older.stamp_ns) / 1e9
        return measured_hz(frame.sequence - older.sequence, span_s, age_s)

    def _age_s(self, unit: Replica | None, frame: Frame) -> float | None:
        now_ns = self._now_ns()
        if unit is None:
            return (now_ns - frame.stamp_ns) / 1e9
        stamp_ns = self._to_local_ns(frame.sender_hw, frame.stamp_ns)
        if stamp_ns is not None:
            return (now_ns - stamp_ns) / 1e9
        # its clock is unknown: the value is at least as old as the loss
        return None if unit.up else (now_ns - unit.gone_ns) / 1e9

    def _quality(self, unit: Replica | None, leaf: Leaf, age_s: float | None, *, known: bool) -> Quality:
        return quality(
            leaf,
            age_s,
            reachable=unit is None or unit.up,
            known=known,
            mirrored=unit is not None,
            interval_s=0.0 if unit is None else unit.interval_s(leaf.resource.path),
        )


def json_text(data: bytes) -> str:
    """MessagePack as JSON text, for display."""
    return msgspec.json.encode(msgspec.msgpack.decode(data)).decode()
