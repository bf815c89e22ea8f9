"""Requests of operators: values, lists and changes of resources of this platform and of others."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Final

import msgspec

from swarmd.tree.core.action import Action
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.values.value import check_settable, typed, unpacked, with_field
from swarmd.tree.operator.tree_view import json_text
from swarmd.tree.operator.type_catalogue import TypeCatalogue
from swarmd.tree.operator.unit_forwarder import UnitForwarder
from swarmd.tree.records.change_log import ChangeLog
from swarmd.tree.records.denial_log import DenialLog
from swarmd.tree.settings.settings import SettingEffect, Settings
from swarmware.errors import Conflict, Denied, NoAnswer, NotFound, SwarmError
from swarmware.model import names, paths
from swarmware.model.access import Verb
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind, Resource
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.driver import CoreDriver
from swarmware.types import registry
from swarmware.types.description import TypeDescription
from swarmware.types.register import PlatformRemoval, PlatformRemoved
from swarmware.types.tree import (
    TreeChange,
    TreeEntry,
    TreeGet,
    TreeList,
    TreeListing,
    TreeReset,
    TreeSet,
    TreeSetDone,
    TreeUndo,
    TreeValue,
    TypeRequest,
)

LIMIT: Final = 5000
"""Maximum number of entries in a reply, which must fit into a frame."""
DEMAND_S: Final = 1.0
"""Time-out of a list for structures that are unknown here."""


class OperatorApi:
    """Serves `sys/tree/get`, `set`, `undo`, `reset`, `list`, `forget` and `type`."""

    def __init__(
        self,
        module: Module,
        tree: SwarmTree,
        driver: CoreDriver[Action],
        stepped: asyncio.Event,
        units: UnitForwarder,
        settings: Settings,
        changes: ChangeLog,
        denials: DenialLog,
    ) -> None:
        """`stepped`: set after each step of the tree, which may have brought a structure."""
        self._module = module
        self._tree = tree
        self._driver = driver
        self._stepped = stepped
        self._units = units
        self._view = units.view
        self._settings = settings
        self._types = TypeCatalogue(module.platform, module.node.applications.table)
        self._changes = changes
        self._denials = denials
        self._effect = SettingEffect(module)

    def serve(self) -> None:
        """Registers the handlers of the requests."""
        serve = self._module.serve
        serve("sys/tree/get", TreeGet, self._get, reply=TreeValue)
        serve("sys/tree/set", TreeSet, self._set, reply=TreeSetDone)
        serve("sys/tree/undo", TreeUndo, self._undo, reply=TreeSetDone)
        serve("sys/tree/reset", TreeReset, self._reset, reply=TreeSetDone)
        serve("sys/tree/list", TreeList, self._list, reply=TreeListing)
        serve("sys/tree/forget", PlatformRemoval, self._forget, reply=PlatformRemoved)
        serve("sys/tree/type", TypeRequest, self._type, reply=TypeDescription)

    # -- get

    async def _get(self, request: TreeGet, meta: Meta) -> TreeValue:
        view = self._view
        platform, local = self._units.split(request.path)
        # also for another platform's: its answer is for this one, or comes from a mirror
        self._denials.check(meta, Verb.GET, local)
        if unit := self._units.provider(request.path):
            return await self._get_at(unit, request, meta)
        if self._units.is_own(platform):
            return view.own_value(view.own_leaf(local), self._settings.version(local))
        if request.fresh or meta.sender_hw != self._module.node.hardware:
            # other nodes ask the owner itself, which alone knows their rights
            raise self._not_its_owner(platform, request.path, "get")
        view.check_platform(platform)
        mirrored = view.mirrored_value(platform, local)
        if mirrored is not None:
            return mirrored
        if not view.is_reachable(platform):
            raise NoAnswer(f"{request.path}: {platform} cannot be reached, and this node has no value of it")
        owner = names.join(platform, "sys/tree/get")
        raise NotFound(
            f"{request.path}: {self._module.platform} has no copy of it; expected a request to {owner}"
        )

    async def _get_at(self, unit: names.Address, request: TreeGet, meta: Meta) -> TreeValue:
        """The value at another computer of this platform; if it does not answer, the mirrored one."""
        path = request.path
        try:
            found = await self._units.forward(unit, "get", request, TreeValue, meta, path)
        except NoAnswer:
            mirrored = self._view.mirrored_value(*self._units.split(path))
            # an old value is better than none, unless the operator asks for the present one
            if mirrored is None or request.fresh:
                raise
            return mirrored
        return msgspec.structs.replace(found, path=names.join(*self._units.split(path)))

    def _not_its_owner(self, platform: str, path: str, verb: str) -> Denied:
        """A request that only the owner of the resource decides, with the rights of who asks."""
        owner = names.join(platform, paths.tree_request(verb))
        return Denied(f"{path}: asked of {self._module.platform}; expected a request to its owner, {owner}")

    # -- type

    async def _type(self, request: TypeRequest, meta: Meta) -> TypeDescription:
        name, platform = request.name, request.platform or self._module.platform
        if self._units.is_own(platform):
            return await self._own_type(request, meta)
        if meta.sender_hw != self._module.node.hardware:
            raise self._not_its_owner(platform, f"type {name!r} of {platform}", "type")
        self._view.check_platform(platform)
        if not self._view.is_reachable(platform):
            return self._types.kept(platform, name)
        try:
            found = await self._module.request(
                names.join(platform, "sys/tree/type"),
                TypeRequest(name),
                TypeDescription,
                timeout_s=self._units.answer_s,
            )
        except NoAnswer:
            return self._types.kept(platform, name)
        self._types.keep(platform, name, found)
        return found

    async def _own_type(self, request: TypeRequest, meta: Meta) -> TypeDescription:
        try:
            return self._types.description(request.name)
        except NotFound:
            if request.platform == self._module.node.address.path:
                raise
            for unit in self._tree.replicas.units.of(self._module.platform):
                asked = TypeRequest(request.name, unit.address.path)
                with contextlib.suppress(NotFound, NoAnswer):
                    return await self._units.forward(unit.address, "type", asked, TypeDescription, meta)
            raise

    # -- changes

    def _own_resource(self, path: str, verb: str) -> Resource:
        """A resource of this platform.

        Raises: NotFound; Denied for another platform, which decides with the rights of who asks.
        """
        platform, local = self._units.split(path)
        if not self._units.is_own(platform):
            raise self._not_its_owner(platform, path, verb)
        return self._view.own_leaf(local).resource

    async def _set(self, request: TreeSet, meta: Meta) -> TreeSetDone:
        path, _dot, field = _without_field(request.path)
        if unit := self._units.provider(path):
            return await self._units.forward(unit, "set", request, TreeSetDone, meta, request.path)
        resource = self._own_resource(path, "set")
        return await self._change_here(resource, meta, partial(self._set_here, resource, field, request))

    async def _undo(self, request: TreeUndo, meta: Meta) -> TreeSetDone:
        if unit := self._units.provider(request.path):
            return await self._units.forward(unit, "undo", request, TreeSetDone, meta, request.path)
        resource = self._own_resource(request.path, "undo")
        return await self._change_here(resource, meta, partial(self._undo_here, resource))

    async def _reset(self, request: TreeReset, meta: Meta) -> TreeSetDone:
        if unit := self._units.provider(request.path):
            return await self._units.forward(unit, "reset", request, TreeSetDone, meta, request.path)
        resource = self._own_resource(request.path, "reset")
        return await self._change_here(resource, meta, partial(self._reset_here, resource))

    async def _change_here(
        self, resource: Resource, meta: Meta, change: Callable[[str, str], Awaitable[TreeSetDone]]
    ) -> TreeSetDone:
        """Make a change and record it, or its refusal. Raises: Denied, as `change`."""
        shown = names.join(self._module.platform, resource.path)
        # read before the change, which replaces it
        before, by = self._view.own_text(resource), self._module.requester(meta)
        via = () if meta.sender is None else meta.sender.via
        try:
            verb = Verb.SET if resource.kind is Kind.SETTING else Verb.CALL
            self._denials.check(meta, verb, resource.path)
            done = await change(shown, by)
        except SwarmError as error:
            await self._changes.record(TreeChange(shown, by, before, "", str(error), via))
            raise
        await self._changes.record(TreeChange(shown, by, before, json_text(done.data), via=via))
        return done

    async def _set_here(
        self, resource: Resource, field: str, request: TreeSet, shown: str, by: str
    ) -> TreeSetDone:
        check_settable(resource, shown)
        plain = unpacked(request.value, shown)
        frame = self._view.own_frame(resource)
        cls = self._types.cls(resource.type)
        if field:
            present = None if frame is None else registry.decode(cls, frame.payload, frame.codec)
            plain = with_field(present, field, plain, shown)
        value = typed(resource, plain, f"{shown}.{field}" if field else shown, cls)
        if resource.kind is Kind.SETTING:
            version = await self._settings.set(resource, value, shown, by, request.version)
            return await self._done(resource, shown, value, version)
        # only a setting has a stored version; of others the sequence of the value takes its place
        if request.version is not None and (frame is None or frame.sequence != request.version):
            have = "no value"
            if frame is not None:
                have = f"version {frame.sequence} ({self._view.own_text(resource)})"
            raise Conflict(f"{shown}: has {have} now; expected version {request.version}")
        return await self._forward_to_owner(resource, shown, value)

    async def _forward_to_owner(self, resource: Resource, shown: str, value: msgspec.Struct) -> TreeSetDone:
        """Forward a value to the application that receives it, as a message or a request."""
        taker = self._module.node.applications.table.serving_path(resource.path)
        # the template may name a resource whose application does not run, or runs in another version
        if taker is None or taker[1].type != resource.type:
            owner = resource.owner or "no application"
            raise Denied(f"{shown}: {owner} does not accept values for it now")
        if taker[1].kind == "request":
            cls = self._types.cls(resource.reply)
            answer = await self._module.request(resource.path, value, cls, timeout_s=self._units.answer_s)
            return TreeSetDone(shown, 0, resource.reply, registry.encode(answer))
        outcome = await self._module.send(resource.path, value, timeout_s=self._units.answer_s)
        if not outcome:
            raise NoAnswer(f"{shown}: {outcome}")
        return TreeSetDone(shown, 0, resource.type, registry.encode(value))

    async def _undo_here(self, resource: Resource, shown: str, by: str) -> TreeSetDone:
        value, version = await self._settings.undo(resource, shown, by)
        return await self._done(resource, shown, value, version)

    async def _reset_here(self, resource: Resource, shown: str, by: str) -> TreeSetDone:
        value, version = await self._settings.reset(resource, shown, by)
        return await self._done(resource, shown, value, version)

    async def _done(self, resource: Resource, shown: str, value: msgspec.Struct, version: int) -> TreeSetDone:
        """The answer to the change of a setting: its applications have taken it, or their time is over."""
        done = TreeSetDone(shown, version, resource.type, registry.encode(value))
        return await self._effect.followed(resource.path, value, done)

    # -- platforms

    def _forget(self, request: PlatformRemoval, _: Meta) -> PlatformRemoved:
        """Raises: Conflict when the platform is reachable."""
        known, actions = self._tree.on_removal(request.platform, self._module.now_ns())
        self._driver.feed(actions)
        return PlatformRemoved(known)

    # -- list

    async def _list(self, request: TreeList, _: Meta) -> TreeListing:
        text = request.pattern
        if not text.startswith("/"):
            text = f"/{self._module.platform}/{text}"
        first, rest = [*text[1:].split("/", 1), ""][:2]
        rest = "**" if first == "**" or not rest else rest
        Pattern(rest)
        wanted = Pattern("*" if first == "**" else first, of_computers=True)
        await self._request_structures(wanted)
        # at least one entry, because a page without entries would look like the end of the list
        limit = max(1, min(request.limit, LIMIT))
        entries: list[TreeEntry] = []
        more = 0
        for platform, leaves in self._view.matching(wanted, rest, request.after):
            shown = leaves[: limit - len(entries)]
            entries += [self._view.entry(platform, leaf) for leaf in shown]
            more += len(leaves) - len(shown)
        platforms = tuple(map(self._view.platform, self._view.platforms()))
        return TreeListing(tuple(entries), more, platforms)

    async def _request_structures(self, wanted: Pattern) -> None:
        """Request unknown structures, and wait for the replies for at most DEMAND_S."""
        replicas = self._tree.replicas
        asked = [
            name
            for name in replicas.platforms()
            if wanted.matches(names.platform_of(name)) or wanted.matches(names.Address.parse(name).path)
        ]
        for platform in asked:
            self._driver.feed(self._tree.on_demand(platform, self._module.now_ns()))
        try:
            async with asyncio.timeout(DEMAND_S):
                # cleared before each wait, because earlier steps have set it
                while any(replicas.asks(platform) for platform in asked):
                    self._stepped.clear()
                    await self._stepped.wait()
        except TimeoutError:
            return  # known structures are listed, others as unknown


def _without_field(path: str) -> tuple[str, str, str]:
    """Path of a resource, point and field; the first segment may name a computer: `/uav3.fc/config/x.y`."""
    end = path.find("/", 1)
    head, rest = (path[:end], path[end:]) if path.startswith("/") and end > 0 else ("", path)
    resource, dot, field = rest.partition(".")
    return head + resource, dot, field
