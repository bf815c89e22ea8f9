"""Requests of operators: values, lists and changes of resources of this platform and of others."""

import asyncio
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from swarmd.tree.core.action import Action
from swarmd.tree.core.index import Index, Leaf
from swarmd.tree.core.quality import Quality, quality
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.value import check_settable, typed, unpacked, with_field
from swarmd.tree.settings import Settings
from swarmd.tree.taps import Peek
from swarmware.errors import Conflict, Denied, NoAnswer, NotFound, SwarmError
from swarmware.model import names
from swarmware.model.access import Access, Verb
from swarmware.model.frame import Frame
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind, Resource
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.node.applications import Applications
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

LIMIT: Final = 5000
"""Maximum number of entries in a reply, which must fit into a frame."""
DEMAND_S: Final = 1.0
"""Time-out of a list for structures that are unknown here."""
_VALUELESS: Final = frozenset({Kind.BRANCH, Kind.COMMAND, Kind.FILE})


class OperatorApi:
    """Serves `sys/tree/get`, `set`, `undo` and `list`."""

    def __init__(
        self,
        module: Module,
        tree: SwarmTree,
        settings: Settings,
        peek: Peek,
        applications: Applications,
        changes: BoardWriter[TreeChange],
        answer_s: float,
        feed: Callable[[list[Action]], None],
    ) -> None:
        """`feed` executes actions of the core."""
        self._module = module
        self._tree = tree
        self._settings = settings
        self._peek = peek
        self._applications = applications
        self._changes = changes
        self._answer_s = answer_s
        self._feed = feed
        self._structures_changed = asyncio.Event()
        self._access = Access()

    def serve(self) -> None:
        """Registers the handlers of the requests."""
        serve = self._module.serve
        serve("sys/tree/get", TreeGet, self._get, reply=TreeValue)
        serve("sys/tree/set", TreeSet, self._set, reply=TreeSetDone)
        serve("sys/tree/undo", TreeUndo, self._undo, reply=TreeSetDone)
        serve("sys/tree/list", TreeList, self._list, reply=TreeListing)

    def on_structures(self) -> None:
        """The structure of another platform may have changed."""
        self._structures_changed.set()

    # -- lookup

    def _split(self, path: str) -> tuple[str, str]:
        platform, local = names.split(names.check_path(path))
        if not local:
            raise NotFound(f"{path}: a platform; expected a resource of it, such as {path}/nav/pose")
        return platform or self._module.platform, local

    def _index(self, platform: str) -> Index | None:
        if platform == self._module.platform:
            return self._tree.local.index
        replica = self._tree.replicas.get(platform)
        return None if replica is None else replica.index

    def _reachable(self, platform: str) -> bool:
        replica = self._tree.replicas.get(platform)
        return platform == self._module.platform or (replica is not None and replica.up)

    def _interval_s(self, platform: str, local: str) -> float:
        replica = self._tree.replicas.get(platform)
        return 0.0 if replica is None else replica.interval_s(local)

    def _platforms(self) -> list[str]:
        return sorted({self._module.platform, *self._tree.replicas.platforms()}, key=names.natural)

    def _own_leaf(self, local: str) -> Leaf:
        """A resource of this platform. Raises: NotFound with similar paths."""
        index = self._tree.local.index
        found = index.get(local)
        if found is None:
            near = ", ".join(names.join(self._module.platform, path) for path in index.near(local))
            hint = f"did you mean {near}?" if near else "expected a path that `swarmctl tree ls` shows"
            raise NotFound(f"{names.join(self._module.platform, local)}: no such resource; {hint}")
        return found

    def _check_platform(self, platform: str) -> None:
        """Raises: NotFound for an unknown platform."""
        if self._tree.replicas.get(platform) is None:
            known = ", ".join(self._platforms())
            raise NotFound(
                f"platform {platform!r}: not known to {self._module.platform}; expected one of {known}"
            )

    # -- rights

    def _by(self, meta: Meta) -> str:
        """The requester for the record of changes, as identified by the transport."""
        if meta.sender is not None:
            return str(meta.sender)
        if meta.sender_hw == self._module.node.hardware:
            entry = self._applications.table.application(meta.sender_app)
            return f"{'?' if entry is None else entry.id}@{self._module.platform}"
        known = (name for name in self._platforms() if names.hardware_id(name) == meta.sender_hw)
        return f"?@{next(known, f'{meta.sender_hw:08x}')}"

    def _check(self, meta: Meta, resource: Resource) -> None:
        """Raises: Denied."""
        verb = Verb.SET if resource.kind is Kind.SETTING else Verb.CALL
        self._access.check(meta.sender, verb, resource.path)

    def _check_direct(self, meta: Meta, path: str) -> None:
        """Reject a change at a third platform, which would have this platform's rights. Raises: Denied."""
        if meta.sender is not None:
            raise Denied(f"{path}: asked of {self._module.platform}; expected a request to its own platform")

    # -- get

    async def _get(self, request: TreeGet, meta: Meta) -> TreeValue:
        platform, local = self._split(request.path)
        if platform == self._module.platform:
            self._access.check(meta.sender, Verb.GET, local)
            return self._own(local, self._own_leaf(local))
        self._check_platform(platform)
        mirrored = None if request.fresh else self._mirrored(platform, local)
        if mirrored is not None and (mirrored.quality == Quality.LIVE or not self._reachable(platform)):
            return mirrored
        if not self._reachable(platform):
            raise NoAnswer(f"{request.path}: {platform} cannot be reached, and this node has no value of it")
        # the owner has the newest value, and finds similar paths
        found = await self._module.request(
            f"/{platform}/sys/tree/get", TreeGet(local), TreeValue, timeout_s=self._answer_s
        )
        stamp_ns = self._module.remote_clocks.to_local(names.hardware_id(platform), found.stamp_ns)
        age_s = found.age_s if stamp_ns is None else (self._module.now_ns() - stamp_ns) / 1e9
        return msgspec.structs.replace(found, source="asked", age_s=age_s)

    def _own(self, local: str, leaf: Leaf) -> TreeValue:
        path, resource = names.join(self._module.platform, local), leaf.resource
        if resource.kind in _VALUELESS:
            raise NotFound(
                f"{path}: a {resource.kind} has no value; expected a board, event, stream or setting"
            )
        frame = self._peek.frame(local)
        if frame is None:
            raise NotFound(f"{path}: no value yet; expected one from {resource.owner or 'its provider'}")
        age_s = (self._module.now_ns() - frame.stamp_ns) / 1e9
        return self._value(path, leaf, frame, age_s, "own", self._settings.version(local))

    def _mirrored(self, platform: str, local: str) -> TreeValue | None:
        """The mirrored value, if it is kept up to date or the only one available."""
        replica = self._tree.replicas.get(platform)
        leaf = None if replica is None or replica.index is None else replica.index.get(local)
        if replica is None or leaf is None:
            return None
        if replica.up and not replica.receives(leaf):
            return None  # left from a former subscription
        frame = self._peek.frame(local, platform)
        if frame is None:
            return None
        return self._value(
            names.join(platform, local), leaf, frame, self._age_s(frame, platform), "mirror", None
        )

    def _age_s(self, frame: Frame, platform: str) -> float | None:
        now_ns = self._module.now_ns()
        stamp_ns = self._module.remote_clocks.to_local(frame.sender_hw, frame.stamp_ns)
        if stamp_ns is not None:
            return (now_ns - stamp_ns) / 1e9
        replica = self._tree.replicas.get(platform)
        # its clock is unknown: the value is at least as old as the loss
        return None if replica is None or replica.up else (now_ns - replica.gone_ns) / 1e9

    def _value(
        self, path: str, leaf: Leaf, frame: Frame, age_s: float | None, source: str, version: int | None
    ) -> TreeValue:
        resource = leaf.resource
        platform = names.split(path)[0] or self._module.platform
        return TreeValue(
            path,
            resource.type,
            registry.messagepack(resource.type, frame.payload, frame.codec),
            frame.stamp_ns,
            frame.sequence,
            frame.sequence if version is None else version,
            age_s,
            quality(
                leaf,
                age_s,
                reachable=self._reachable(platform),
                known=True,
                mirrored=platform != self._module.platform,
                interval_s=self._interval_s(platform, resource.path),
            ),
            resource.unit,
            resource.owner,
            source,
        )

    # -- set

    async def _set(self, request: TreeSet, meta: Meta) -> TreeSetDone:
        path, _dot, field = request.path.partition(".")
        platform, local = self._split(path)
        if platform != self._module.platform:
            self._check_direct(meta, request.path)
            self._check_platform(platform)
            there = msgspec.structs.replace(request, path=f"{local}.{field}" if field else local)
            return await self._module.request(
                f"/{platform}/sys/tree/set", there, TreeSetDone, timeout_s=self._answer_s
            )
        resource = self._own_leaf(local).resource
        shown = names.join(platform, local)
        before = self._text(local, resource)
        by = self._by(meta)
        try:
            self._check(meta, resource)
            done = await self._change(resource, shown, field, request)
        except SwarmError as error:
            self._changes.write(TreeChange(shown, by, before, "", str(error)))
            raise
        self._changes.write(TreeChange(shown, by, before, _json(done.data)))
        return done

    async def _change(self, resource: Resource, shown: str, field: str, request: TreeSet) -> TreeSetDone:
        check_settable(resource, shown)
        plain = unpacked(request.value, shown)
        frame = self._peek.frame(resource.path)
        if field:
            present = None if frame is None else self._decoded(resource, frame)
            plain = with_field(present, field, plain, shown)
        value = typed(resource, plain, f"{shown}.{field}" if field else shown)
        if resource.kind is Kind.SETTING:
            version = await self._settings.set(resource, value, shown, request.version)
            return TreeSetDone(shown, version, resource.type, registry.encode(value))
        if request.version is not None and (frame is None or frame.sequence != request.version):
            have = "no value" if frame is None else f"version {frame.sequence}"
            raise Conflict(f"{shown}: has {have} now; expected version {request.version}")
        return await self._forward_to_owner(resource, shown, value)

    async def _forward_to_owner(self, resource: Resource, shown: str, value: msgspec.Struct) -> TreeSetDone:
        """Forward a value to the application that receives it, as a message or a request."""
        taker = self._applications.table.serving_path(resource.path)
        if taker is None or taker[1].type != resource.type:
            owner = resource.owner or "no application"
            raise Denied(f"{shown}: {owner} does not accept values for it now")
        if taker[1].kind == "request":
            cls = registry.find(resource.reply)
            answer = await self._module.request(resource.path, value, cls, timeout_s=self._answer_s)
            return TreeSetDone(shown, 0, resource.reply, registry.encode(answer))
        outcome = await self._module.send(resource.path, value, timeout_s=self._answer_s)
        if not outcome:
            raise NoAnswer(f"{shown}: {outcome}")
        return TreeSetDone(shown, 0, resource.type, registry.encode(value))

    async def _undo(self, request: TreeUndo, meta: Meta) -> TreeSetDone:
        platform, local = self._split(request.path)
        if platform != self._module.platform:
            self._check_direct(meta, request.path)
            self._check_platform(platform)
            there = msgspec.structs.replace(request, path=local)
            return await self._module.request(
                f"/{platform}/sys/tree/undo", there, TreeSetDone, timeout_s=self._answer_s
            )
        resource = self._own_leaf(local).resource
        shown = names.join(platform, local)
        before = self._text(local, resource)
        by = self._by(meta)
        try:
            self._check(meta, resource)
            value, version = await self._settings.undo(resource, shown)
        except SwarmError as error:
            self._changes.write(TreeChange(shown, by, before, "", str(error)))
            raise
        done = TreeSetDone(shown, version, resource.type, registry.encode(value))
        self._changes.write(TreeChange(shown, by, before, _json(done.data)))
        return done

    def _decoded(self, resource: Resource, frame: Frame) -> msgspec.Struct:
        return registry.decode(registry.find(resource.type), frame.payload, frame.codec)

    def _text(self, local: str, resource: Resource) -> str:
        frame = None if resource.kind in _VALUELESS else self._peek.frame(local)
        if frame is None:
            return ""
        try:
            return _json(registry.messagepack(resource.type, frame.payload, frame.codec))
        except SwarmError:
            return ""

    # -- list

    async def _list(self, request: TreeList, _: Meta) -> TreeListing:
        text = request.pattern
        if not text.startswith("/"):
            text = f"/{self._module.platform}/{text}"
        first, rest = [*text[1:].split("/", 1), ""][:2]
        rest = "**" if first == "**" or not rest else rest
        Pattern(rest)
        wanted = Pattern("*" if first == "**" else first)
        await self._request_structures(wanted)
        limit = max(1, min(request.limit, LIMIT))
        entries: list[TreeEntry] = []
        more = 0
        for platform, leaf in self._matching(wanted, rest, request.after):
            if len(entries) < limit:
                entries.append(self._entry(platform, leaf))
            else:
                more += 1
        return TreeListing(tuple(entries), more, tuple(map(self._platform, self._platforms())))

    async def _request_structures(self, wanted: Pattern) -> None:
        """Request unknown structures, and wait for the replies for at most DEMAND_S."""
        replicas = self._tree.replicas
        asked = [platform for platform in replicas.platforms() if wanted.matches(platform)]
        for platform in asked:
            self._feed(self._tree.on_demand(platform, self._module.now_ns()))
        try:
            async with asyncio.timeout(DEMAND_S):
                while any(replicas.asks(platform) for platform in asked):
                    self._structures_changed.clear()
                    await self._structures_changed.wait()
        except TimeoutError:
            return  # known structures are listed, others as unknown

    def _matching(self, wanted: Pattern, rest: str, after: str) -> Iterator[tuple[str, Leaf]]:
        last, last_local = names.split(after) if after else (None, "")
        for platform in self._platforms():
            index = self._index(platform)
            if index is None or not wanted.matches(platform):
                continue
            if last is not None and names.natural(platform) < names.natural(last):
                continue
            for leaf in index.match(rest, after=last_local if platform == last else ""):
                yield platform, leaf

    def _platform(self, platform: str) -> TreePlatform:
        index = self._index(platform)
        size, digest = (0, 0) if index is None else (len(index), index.digest)
        return TreePlatform(platform, self._reachable(platform), size, digest)

    def _entry(self, platform: str, leaf: Leaf) -> TreeEntry:
        resource = leaf.resource
        own = platform == self._module.platform
        frame = None
        if resource.kind not in _VALUELESS:
            frame = self._peek.frame(resource.path, None if own else platform)
        age_s = None if frame is None else self._age_s(frame, platform)
        reachable = self._reachable(platform)
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
            quality(
                leaf,
                age_s,
                reachable=reachable,
                known=frame is not None,
                mirrored=not own,
                interval_s=self._interval_s(platform, resource.path),
            ),
            resource.range,
            resource.choices,
            resource.log,
            resource.reply,
            resource.description,
            resource.confirm,
        )


def _json(data: bytes) -> str:
    return msgspec.json.encode(msgspec.msgpack.decode(data)).decode()
