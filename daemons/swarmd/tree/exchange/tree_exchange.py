"""Exchange with the trees of other nodes: requests, replies and notifications, in both directions."""

import asyncio
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import msgspec

from swarmd.tree.core.action import Action, RequestStructure, RequestSubscription, SendNotify
from swarmd.tree.core.notification.lane import LANE
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.values.input_meter import InputMeter
from swarmd.tree.exchange.boundary import Boundary
from swarmd.tree.exchange.item_coder import ItemCoder
from swarmware.errors import Denied, SwarmError
from swarmware.model import names, paths
from swarmware.model.compression import READABLE
from swarmware.module.inbox import Inbox
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.driver import CoreDriver
from swarmware.types.tree_exchange import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeNotify,
)

AT_ONCE: Final = 32
"""Maximum number of concurrent requests to other trees, in a large swarm."""

log = logging.getLogger("swarm.tree")


class TreeExchange:
    """Sends the core's requests and notifications to other trees, and feeds the core what they send."""

    def __init__(
        self,
        module: Module,
        tree: SwarmTree,
        driver: CoreDriver[Action],
        boundary: Boundary,
        answer_s: float,
    ) -> None:
        """`answer_s`: time-out of requests to other trees."""
        self._module = module
        self._tree = tree
        self._driver = driver
        self._boundary = boundary
        self._answer_s = answer_s
        self._at_once = asyncio.Semaphore(AT_ONCE)
        self._notifications: Inbox[TreeNotify] = module.inbox(
            "sys/tree/notify", TreeNotify, limit=4 * LANE.count_max
        )
        self.asked = 0
        """Number of requests to other trees."""
        self.answered = 0
        """Number of requests of other trees."""
        self.notified = 0
        """Number of notifications of other trees."""
        self.coder = ItemCoder(boundary)
        """Compression of notifications."""
        self._meters: list[InputMeter] = []

    # -- from other trees

    def serve(self) -> None:
        """Registers the handlers of the requests."""
        serve = self._module.serve
        serve("sys/tree/structure", StructureRequest, self._on_structure, reply=StructureReply)
        serve("sys/tree/subscribe", SubscribeRequest, self._on_subscribe, reply=SubscribeReply)

    def _on_structure(self, request: StructureRequest, meta: Meta) -> StructureReply:
        _check_sender(request.platform, meta)
        self.answered += 1
        reply, actions = self._tree.on_structure_asked(request, self._module.now_ns())
        self._driver.defer(actions)  # the reply is sent first
        return reply

    def _on_subscribe(self, request: SubscribeRequest, meta: Meta) -> SubscribeReply:
        _check_sender(request.platform, meta)
        self.answered += 1
        reply, actions = self._tree.on_subscribe_asked(request, meta.sender, self._module.now_ns())
        self._driver.defer(actions)
        return reply

    async def follow_notifications(self) -> None:
        """Feeds the core the notifications of other trees, until cancelled."""
        inbox = self._notifications
        async for received in inbox:
            if inbox.meta is None or inbox.meta.sender_hw != names.hardware_id(received.platform):
                log.warning("notification with the name of %s from another node; dropped", received.platform)
                continue
            self.notified += 1
            notify = self.coder.plain(received)
            for meter in self._meters:
                meter.on_items(notify.platform, inbox.meta.sender_hw, notify.items, self._module.now_ns())
            with self._boundary(f"notification of {notify.platform}"):
                self._driver.feed(self._tree.on_notify(notify, self._module.now_ns()))

    @contextmanager
    def metered(self, meter: InputMeter) -> Iterator[None]:
        """Have a meter count the values that arrive meanwhile."""
        self._meters.append(meter)
        try:
            yield
        finally:
            self._meters.remove(meter)

    # -- to other trees

    async def ask_structure(self, action: RequestStructure) -> None:
        """Requests a structure and feeds the core the reply."""
        # no reply is an event as well: the core then waits and repeats the request
        path, reply = _at(action.platform, "structure"), None
        async with self._at_once:
            self.asked += 1
            try:
                reply = await self._module.request(
                    path, action.request, StructureReply, timeout_s=self._answer_by_s()
                )
            except SwarmError as error:
                log.debug("structure of %s: %s", action.platform, error)
        with self._boundary(f"structure of {action.platform}"):
            self._driver.feed(self._tree.on_structure(action.platform, reply, self._module.now_ns()))

    async def ask_subscription(self, action: RequestSubscription) -> None:
        """Requests a subscription and feeds the core the reply."""
        path, reply = _at(action.platform, "subscribe"), None
        async with self._at_once:
            self.asked += 1
            try:
                reply = await self._module.request(
                    path,
                    # the installed methods, which the core need not know
                    msgspec.structs.replace(action.request, reads=READABLE),
                    SubscribeReply,
                    timeout_s=self._answer_by_s(),
                )
            except SwarmError as error:
                log.debug("subscription at %s: %s", action.platform, error)
        with self._boundary(f"subscription at {action.platform}"):
            asked, now_ns = action.request.set_digest, self._module.now_ns()
            self._driver.feed(self._tree.on_subscribed(action.platform, reply, asked, now_ns))

    async def send(self, action: SendNotify) -> None:
        """Sends a notification and feeds the core its result."""
        path = _at(action.platform, "notify")
        notify = await self.coder.coded(action)
        # a message, not a request: the acknowledgement needs no payload
        outcome = await self._module.send(path, notify, timeout_s=self._answer_by_s(), kind=action.kind)
        now_ns = self._module.now_ns()
        self._driver.feed(self._tree.on_notified(action.platform, action.notify, bool(outcome), now_ns))

    def _answer_by_s(self) -> float:
        """Time-out of a request; what arrives later than that is refused, and sent again."""
        return self._answer_s + self._tree.patience_s(self._module.now_ns())


def _at(node: str, verb: str) -> str:
    """Path of a request to the tree of exactly this node."""
    return names.join(names.Address.parse(node).path, paths.tree_request(verb))


def _check_sender(platform: str, meta: Meta) -> None:
    if names.hardware_id(platform) != meta.sender_hw:
        raise Denied(f"platform {platform!r}: the request came from another one; expected its own name")
