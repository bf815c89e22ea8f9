"""The tree of this computer: the template of its platform, and the resources of running applications."""

import logging
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final

import msgspec

from swarmd.tree.core.structure.index import Index, Leaf, leaf
from swarmd.tree.core.structure.structure import History, StructureEncoding, encode, version
from swarmware.model.resource import Kind, Link, Resource, clash_text, clashes
from swarmware.types.tree_exchange import StructureReply, StructureRequest

log = logging.getLogger("swarm.tree")

_FACTS: Final = ("owner", "reply", "unit", "rate_hz")
"""Fields that the running application defines; the template defines the others."""


_ANSWERS: Final = 64
"""Cached replies: platforms that start together request the same."""


class OwnerTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """Time-outs for owners that have ended."""

    lost_ns: int
    """Time from an owner's end to `lost`; longer than a restart."""
    expire_ns: int
    """Time from `lost` to the removal of resources that are not in the template."""


def merge(base: Resource | None, live: Resource) -> Resource:
    """Merge two descriptors: the policy of the template with the facts of the application."""
    if base is None:
        return live
    if live.kind is Kind.COMMAND and base.kind is not Kind.COMMAND and live.type == base.type:
        return msgspec.structs.replace(base, owner=live.owner)  # messages to it set its value
    if base.kind is not live.kind or base.type != live.type:
        log.warning(
            "%s: %s provides it as %s %s, the template defines %s %s",
            base.path, live.owner, live.kind, live.type, base.kind, base.type,
        )  # fmt: skip
        return live
    facts = {field: value for field in _FACTS if (value := getattr(live, field))}
    if not base.description:
        facts["description"] = live.description
    return msgspec.structs.replace(base, **facts)


def _own_link(resource: Resource) -> Link:
    return resource.link


class LocalTree:
    """The template's resources, merged with the resources of running applications.

    A resource of an ended application is `lost` after a time, and later in its state before the start. The
    unit `main` also has the template's resources without an application, unless another unit provides them.
    """

    def __init__(
        self,
        template: Iterable[Resource],
        epoch: int,
        timing: OwnerTimeouts,
        *,
        has_template: bool = True,
    ) -> None:
        """`has_template`: whether resources of the template without an application are part of this tree."""
        self._timing = timing
        self._base = {resource.path: resource for resource in template}
        self._elsewhere: frozenset[str] = frozenset()
        """Paths that other units of this platform provide."""
        self._template = Index(leaf(resource) for resource in self._base.values() if has_template)
        self.index = self._template.copy()
        self.epoch = epoch
        self._live: dict[str, Resource] = {}
        self.held_version = 0
        """Incremented when applications provide other paths."""
        self.refused: dict[str, str] = {}
        """Resources of running applications that are not in the tree, and why."""
        self._gone: dict[str, int] = {}
        """Path of an ended owner → when it ended."""
        self._link_of: Callable[[Resource], Link] = _own_link
        """How values travel by the rules of channels."""
        self._history = History()
        self._answers: dict[tuple[int, bool], StructureReply] = {}

    @property
    def digest(self) -> int:
        """Digest of the present structure."""
        return self.index.digest

    @property
    def version(self) -> int:
        """Version that the beacon carries."""
        return version(self.epoch, self.index.digest)

    def set_live(self, provided: Iterable[Resource], now_ns: int) -> bool:
        """Set the resources of the running applications; returns True if the structure changed.

        A resource whose number in frames an earlier one has is left out: `refused` names both.
        """
        live: dict[str, Resource] = {}
        for resource in provided:
            other = live.get(resource.path)
            # an application may have an inbox at the path of its board: the board is the resource
            if other is None or other.kind is Kind.COMMAND:
                live[resource.path] = resource
        self._refuse_clashes(live)
        ended = self._live.keys() - live.keys()
        for path in ended - self._elsewhere:
            self._gone.setdefault(path, now_ns)
        for path in live:
            self._gone.pop(path, None)
        changed = {path for path, resource in live.items() if self._live.get(path) != resource}
        self.held_version += self._live.keys() != live.keys()
        self._live = live
        return self._change(map(self._leaf, changed), ended & self._elsewhere)

    def _refuse_clashes(self, live: dict[str, Resource]) -> None:
        """Removes resources whose number a path of the template, or an earlier resource, has."""
        found = clashes([*self._base.values(), *live.values()])
        refused = {path: clash_text(path, other) for path, other in found.items() if live.pop(path, None)}
        for path in refused.keys() - self.refused.keys():
            log.error("resource %s", refused[path])
        self.refused = refused

    def _leaf(self, path: str) -> Leaf:
        """The leaf of a resource that an application provides."""
        resource = merge(self._base.get(path), self._live[path])
        link = self._link_of(resource)
        return leaf(resource if link == resource.link else msgspec.structs.replace(resource, link=link))

    def set_links(self, link_of: Callable[[Resource], Link]) -> bool:
        """Set how the values of resources travel; returns True if the structure changed."""
        self._link_of = link_of
        return self._change(map(self._leaf, self._live), ())

    def set_elsewhere(self, paths: Collection[str]) -> bool:
        """Set what other units of this platform provide; returns True if the structure changed."""
        before, self._elsewhere = self._elsewhere, frozenset(paths)
        removed = [path for path in self._elsewhere - before if path not in self._live]
        for path in removed:
            self._gone.pop(path, None)  # it runs there now
        back = [
            item
            for path in before - self._elsewhere
            if path not in self._live and (item := self._template.get(path)) is not None
        ]
        return self._change(back, removed)

    def holds(self, path: str) -> bool:
        """Whether an application of this computer provides it, or it is a setting that is kept here."""
        if path in self._live:
            return True
        item = self.index.get(path)
        return item is not None and item.resource.kind is Kind.SETTING

    def setting(self, path: str, owner: str) -> Resource | None:
        """A setting of the template with this owner, or None if the template has none."""
        base = self._base.get(path)
        if base is None or base.kind is not Kind.SETTING:
            return None
        return msgspec.structs.replace(base, owner=owner)

    def advance(self, now_ns: int) -> bool:
        """Mark resources as lost, remove expired ones; returns True if the structure changed."""
        lost: list[Leaf] = []
        removed: list[str] = []
        for path, since_ns in list(self._gone.items()):
            item = self.index.get(path)
            if item is None:
                del self._gone[path]
            elif now_ns >= since_ns + self._timing.lost_ns + self._timing.expire_ns:
                del self._gone[path]
                base = self._template.get(path)
                if base is None:
                    removed.append(path)
                else:
                    lost.append(base)
            elif now_ns >= since_ns + self._timing.lost_ns and not item.lost:
                lost.append(leaf(item.resource, lost=True))
        return self._change(lost, removed)

    def deadline_ns(self) -> int | None:
        """Next call of `advance`."""
        if not self._gone:
            return None
        deadlines = [
            since_ns
            + self._timing.lost_ns
            + (self._timing.expire_ns if (item := self.index.get(path)) is not None and item.lost else 0)
            for path, since_ns in self._gone.items()
        ]
        return min(deadlines, default=None)

    def _change(self, put: Iterable[Leaf], removed: Iterable[str]) -> bool:
        before = self.index.digest
        paths = {item.resource.path for item in put if self.index.put(item)}
        paths |= {path for path in removed if self.index.remove(path)}
        if not paths:
            return False
        self._history.add(before, frozenset(paths))
        self._answers.clear()
        return True

    def changes_since(self, digest: int) -> bytes | None:
        """Encoded changes from a former structure, or None if they are unknown."""
        paths = self._history.since(digest)
        if paths is None:
            return None
        found = {path: self.index.get(path) for path in paths}
        return _encode(found)

    def changes_to_template(self) -> StructureReply | None:
        """The structure for nodes that have the template, or None if it is empty."""
        if not self.index.digest:
            return None
        return self.answer(StructureRequest("", self.epoch, 0))

    def answer(self, request: StructureRequest) -> StructureReply:
        """Reply to a structure request (step 3 of S0.56), in the smallest encoding for the requester."""
        known = self._answers.get((request.held, request.full))
        if known is None:
            if len(self._answers) >= _ANSWERS:
                self._answers.clear()
            known = self._answers[request.held, request.full] = self._make_answer(request)
        return known

    def _make_answer(self, request: StructureRequest) -> StructureReply:
        digest = self.index.digest
        if request.held == digest and not request.full:
            return StructureReply(self.epoch, digest, StructureEncoding.UNCHANGED)
        if request.held and not request.full:
            changes = self.changes_since(request.held)
            if changes is not None:
                return StructureReply(self.epoch, digest, StructureEncoding.CHANGES, 0, changes)
        found: dict[str, Leaf | None] = {
            item.resource.path: item
            for item in self.index
            if (base := self._template.get(item.resource.path)) is None or base.mark != item.mark
        }
        found |= {item.resource.path: None for item in self._template if item.resource.path not in self.index}
        if request.full:
            data = _encode(found, self._template)
            return StructureReply(self.epoch, digest, StructureEncoding.FULL, self._template.digest, data)
        return StructureReply(
            self.epoch, digest, StructureEncoding.TEMPLATE, self._template.digest, _encode(found)
        )


def _encode(found: Mapping[str, Leaf | None], template: Iterable[Leaf] = ()) -> bytes:
    return encode(
        (item for item in found.values() if item is not None),
        (path for path, item in found.items() if item is None),
        template,
    )
