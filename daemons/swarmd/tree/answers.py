"""Answers to operators: values, lists and changes of resources, of this platform and of the others."""

from collections.abc import Iterator

import msgspec

from swarmd.tree.core.index import Index, Leaf
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.value import check_settable, typed, unpacked, with_field
from swarmd.tree.settings import Settings
from swarmd.tree.taps import Peek, plain_payload
from swarmware import names
from swarmware.errors import Conflict, NoAnswer, NotFound, SwarmError
from swarmware.frame import Frame
from swarmware.module import BoardWriter, Meta, Module
from swarmware.names import Pattern
from swarmware.resource import Kind, Resource
from swarmware.types import registry
from swarmware.types.tree import (
    TreeChange,
    TreeEntry,
    TreeGet,
    TreeList,
    TreeListing,
    TreePlatform,
    TreeSet,
    TreeSetDone,
    TreeUndo,
    TreeValue,
)

LIMIT = 5000
"""Entries of one answer at most: it must fit a frame."""


class Answers:
    """Serves `sys/tree/get`, `set`, `undo` and `list`."""

    def __init__(
        self,
        module: Module,
        tree: SwarmTree,
        settings: Settings,
        peek: Peek,
        changes: BoardWriter[TreeChange],
        answer_s: float,
    ) -> None:
        self._module = module
        self._tree = tree
        self._settings = settings
        self._peek = peek
        self._changes = changes
        self._answer_s = answer_s

    async def serve(self) -> None:
        """Takes requests from now on."""
        serve = self._module.serve
        await serve("sys/tree/get", TreeGet, self._get, reply=TreeValue, description="Newest value")
        await serve("sys/tree/set", TreeSet, self._set, reply=TreeSetDone, description="Set a value")
        await serve("sys/tree/undo", TreeUndo, self._undo, reply=TreeSetDone, description="Undo a set")
        await serve("sys/tree/list", TreeList, self._list, reply=TreeListing, description="Resources")

    # -- where things are

    def _split(self, path: str) -> tuple[str, str]:
        platform, local = names.split(names.check_path(path))
        return platform or self._module.platform, local

    def _index(self, platform: str) -> Index | None:
        if platform == self._module.platform:
            return self._tree.local.index
        remote = self._tree.remotes.get(platform)
        return None if remote is None else remote.index

    def _reachable(self, platform: str) -> bool:
        remote = self._tree.remotes.get(platform)
        return remote is not None and remote.up

    def _leaf(self, platform: str, local: str) -> Leaf | None:
        """The resource; None when the platform is there but its tree is not known yet.

        Raises: NotFound for an unknown platform or path.
        """
        index = self._index(platform)
        if index is None:
            if self._reachable(platform):
                return None
            known = ", ".join(self._platforms())
            raise NotFound(f"platform {platform!r}: not known to {self._module.platform}; known: {known}")
        found = index.get(local)
        if found is None:
            near = index.near(local)
            hint = f"did you mean {', '.join(near)}?" if near else "`swarmctl tree ls` shows what there is"
            raise NotFound(f"{names.join(platform, local)}: no such resource; {hint}")
        return found

    def _platforms(self) -> list[str]:
        return sorted({self._module.platform, *self._tree.remotes.platforms()}, key=names.natural)

    # -- get

    async def _get(self, request: TreeGet, _: Meta) -> TreeValue:
        platform, local = self._split(request.path)
        leaf = self._leaf(platform, local)
        if platform == self._module.platform:
            assert leaf is not None
            return self._own(local, leaf)
        if leaf is not None and not request.fresh:
            mirrored = self._mirrored(platform, local, leaf)
            if mirrored is not None and mirrored.quality == "live":
                return mirrored
        found = await self._module.request(
            f"/{platform}/sys/tree/get", TreeGet(local), TreeValue, timeout_s=self._answer_s
        )
        stamp = self._module.foreign.to_local(names.hardware_id(platform), found.stamp_ns)
        age_s = found.age_s if stamp is None else (self._module.now_ns() - stamp) / 1e9
        return msgspec.structs.replace(found, source="asked", age_s=age_s)

    def _own(self, local: str, leaf: Leaf) -> TreeValue:
        path = names.join(self._module.platform, local)
        resource = leaf.resource
        if resource.kind in {Kind.BRANCH, Kind.COMMAND, Kind.FILE}:
            raise NotFound(
                f"{path}: a {resource.kind} has no value; expected a board, event, stream or setting"
            )
        frame = self._peek.frame(local)
        if frame is None:
            owner = f"{resource.owner} writes it" if resource.owner else "nobody writes it"
            raise NotFound(f"{path}: no value yet; {owner}")
        age_s = (self._module.now_ns() - frame.stamp_ns) / 1e9
        return self._value(path, leaf, frame, age_s, "own", self._settings.version(local))

    def _mirrored(self, platform: str, local: str, leaf: Leaf) -> TreeValue | None:
        frame = self._peek.frame(local, platform)
        if frame is None:
            return None
        stamp_ns = self._module.foreign.to_local(frame.sender_hw, frame.stamp_ns)
        age_s = None if stamp_ns is None else (self._module.now_ns() - stamp_ns) / 1e9
        return self._value(names.join(platform, local), leaf, frame, age_s, "mirror", None)

    def _value(
        self, path: str, leaf: Leaf, frame: Frame, age_s: float | None, source: str, version: int | None
    ) -> TreeValue:
        resource = leaf.resource
        return TreeValue(
            path,
            resource.type,
            plain_payload(frame, resource.type),
            frame.stamp_ns,
            frame.sequence,
            frame.sequence if version is None else version,
            age_s,
            _quality(leaf, age_s),
            resource.unit,
            resource.owner,
            source,
        )

    # -- set

    async def _set(self, request: TreeSet, meta: Meta) -> TreeSetDone:
        path, _, fields = request.path.partition(".")
        platform, local = self._split(path)
        leaf = self._leaf(platform, local)
        if platform != self._module.platform:
            there = msgspec.structs.replace(request, path=f"{local}.{fields}" if fields else local)
            return await self._module.request(
                f"/{platform}/sys/tree/set", there, TreeSetDone, timeout_s=self._answer_s
            )
        assert leaf is not None
        shown = names.join(platform, local)
        before = self._text(local, leaf.resource)
        try:
            done = await self._change(leaf.resource, local, shown, fields, request)
        except SwarmError as error:
            self._changes.write(TreeChange(shown, request.by, before, "", str(error)))
            raise
        self._changes.write(TreeChange(shown, request.by, before, self._text(local, leaf.resource)))
        return done

    async def _change(
        self, resource: Resource, local: str, shown: str, fields: str, request: TreeSet
    ) -> TreeSetDone:
        check_settable(resource, shown)
        plain = unpacked(request.value, shown)
        if fields:
            plain = with_field(self._current(local, resource), fields, plain, shown)
        value = typed(resource, plain, f"{shown}.{fields}" if fields else shown)
        version = 0
        if resource.kind is Kind.SETTING:
            present = self._settings.version(local)
            if request.version is not None and request.version != present:
                raise Conflict(f"{shown}: has version {present} now; expected {request.version}")
            version = await self._settings.set(resource, value)
        else:
            outcome = await self._module.send(local, value, timeout_s=self._answer_s)
            if not outcome:
                raise NoAnswer(f"{shown}: {outcome}")
        return TreeSetDone(shown, version, resource.type, registry.encode(value))

    async def _undo(self, request: TreeUndo, _: Meta) -> TreeSetDone:
        platform, local = self._split(request.path)
        leaf = self._leaf(platform, local)
        if platform != self._module.platform:
            there = msgspec.structs.replace(request, path=local)
            return await self._module.request(
                f"/{platform}/sys/tree/undo", there, TreeSetDone, timeout_s=self._answer_s
            )
        assert leaf is not None
        shown = names.join(platform, local)
        before = self._text(local, leaf.resource)
        value, version = await self._settings.undo(leaf.resource, shown)
        self._changes.write(TreeChange(shown, request.by, before, self._text(local, leaf.resource)))
        return TreeSetDone(shown, version, leaf.resource.type, registry.encode(value))

    def _current(self, local: str, resource: Resource) -> msgspec.Struct | None:
        frame = self._peek.frame(local)
        if frame is None:
            return None
        return registry.decode(registry.find(resource.type), frame.payload, frame.codec)

    def _text(self, local: str, resource: Resource) -> str:
        try:
            value = self._current(local, resource)
        except SwarmError:
            return ""
        return "" if value is None else msgspec.json.encode(value).decode()

    # -- list

    def _list(self, request: TreeList, _: Meta) -> TreeListing:
        pattern = request.pattern
        if not pattern.startswith("/"):
            pattern = f"/{self._module.platform}/{pattern}"
        first, rest = [*pattern[1:].split("/", 1), ""][:2]
        rest = "**" if first == "**" or not rest else rest
        wanted = Pattern("*" if first == "**" else first)
        limit = max(1, min(request.limit, LIMIT))
        entries: list[TreeEntry] = []
        more = 0
        for platform, leaf in self._matching(wanted, rest, request.after):
            if len(entries) < limit:
                entries.append(self._entry(platform, leaf))
            else:
                more += 1
        return TreeListing(tuple(entries), more, tuple(map(self._platform, self._platforms())))

    def _matching(self, wanted: Pattern, rest: str, after: str) -> Iterator[tuple[str, Leaf]]:
        after_platform, after_local = names.split(after) if after else (None, "")
        skipping = bool(after_platform)
        for platform in self._platforms():
            if skipping and platform != after_platform:
                continue
            start = after_local if platform == after_platform else ""
            skipping = False
            if not wanted.matches(platform):
                continue
            index = self._index(platform)
            if index is None:
                self._tree.remotes.demand(platform)
                continue
            for leaf in index.match(rest, after=start):
                yield platform, leaf

    def _platform(self, platform: str) -> TreePlatform:
        index = self._index(platform)
        own = platform == self._module.platform
        return TreePlatform(
            platform,
            own or self._reachable(platform),
            len(index) if index is not None else 0,
            index.digest if index is not None else 0,
        )

    def _entry(self, platform: str, leaf: Leaf) -> TreeEntry:
        resource = leaf.resource
        own = platform == self._module.platform
        valued = resource.kind not in {Kind.BRANCH, Kind.COMMAND, Kind.FILE}
        frame = self._peek.frame(resource.path, None if own else platform) if valued else None
        age_s = None
        quality = "lost" if leaf.lost else "none"
        if frame is not None:
            stamp_ns = (
                frame.stamp_ns if own else self._module.foreign.to_local(frame.sender_hw, frame.stamp_ns)
            )
            age_s = None if stamp_ns is None else (self._module.now_ns() - stamp_ns) / 1e9
            quality = _quality(leaf, age_s)
        return TreeEntry(
            names.join(platform, resource.path),
            str(resource.kind),
            resource.type,
            resource.unit,
            resource.access,
            resource.rate_hz,
            resource.category,
            resource.link,
            resource.owner,
            age_s,
            quality,
            resource.range,
            resource.choices,
            resource.log,
            resource.reply,
            resource.description,
        )


def _quality(leaf: Leaf, age_s: float | None) -> str:
    if leaf.lost:
        return "lost"
    if age_s is None:
        return "stale" if leaf.resource.periodic else "live"
    return "live" if age_s <= leaf.resource.stale_after_s else "stale"
