"""Compression of the items of notifications: measured, shared by subscribers, large ones beside the loop."""

import asyncio
import logging
from collections import Counter
from collections.abc import Sequence
from time import thread_time_ns
from typing import Final

import msgspec

from swarmd.tree.core.action import Coding, SendNotify
from swarmd.tree.core.notification.item_coding import code, decode, is_worth, runs
from swarmd.tree.exchange.boundary import Boundary
from swarmware.errors import SwarmError, WireError
from swarmware.model.compression import CONTAINER, Method
from swarmware.module.jpeg import to_jpeg
from swarmware.types import registry
from swarmware.types.channel import CompressionState
from swarmware.types.perception import Image
from swarmware.types.tree_exchange import TreeItem, TreeNotify

BESIDE_BYTES: Final = 128 * 1024
"""Values of more bytes are coded in a thread: a loop that stops for 50 ms delays commands."""
SHARED: Final = 64
"""Coded runs that are kept for other subscribers."""

log = logging.getLogger("swarm.tree")

_Key = tuple[str, int, int, int, Coding]


class ItemCoder:
    """Codes what is sent to other trees, and decodes what comes from them."""

    def __init__(self, boundary: Boundary) -> None:
        self._boundary = boundary
        self._shared: dict[_Key, list[TreeItem]] = {}
        self._plain_bytes: Counter[str] = Counter()
        self._coded_bytes: Counter[str] = Counter()
        self._spent_ns: Counter[str] = Counter()
        self._refused: dict[str, str] = {}
        """Why the values of a resource cannot be coded."""

    def states(self) -> tuple[CompressionState, ...]:
        """State of the compression of each path."""
        return tuple(
            CompressionState(
                path,
                self._plain_bytes[path],
                self._coded_bytes[path],
                self._spent_ns[path] / 1e9,
                self._refused.get(path, ""),
            )
            for path in sorted(self._plain_bytes.keys() | self._refused.keys())
        )

    async def coded(self, action: SendNotify) -> TreeNotify:
        """The notification of an action as it is sent."""
        notify = action.notify
        if not action.codings:
            return notify
        items: list[TreeItem] = []
        for path, run in runs(notify.items):
            coding = action.codings.get(path)
            items += run if coding is None else await self._coded_run(path, run, coding)
        return msgspec.structs.replace(notify, items=tuple(items))

    async def _coded_run(self, path: str, run: list[TreeItem], coding: Coding) -> list[TreeItem]:
        if not is_worth(run, coding):
            return run
        # subscribers of one channel get the same runs, and coding costs far more than the look-up
        key = (path, run[0].sequence, run[0].stamp_ns, len(run), coding)
        found = self._shared.get(key)
        if found is not None:
            return found
        size = sum(len(item.data) for item in run)
        try:
            # a small run is coded at once, without another turn of the event loop
            if size > BESIDE_BYTES:
                coded, spent_ns = await asyncio.to_thread(_measured, run, coding)
            else:
                coded, spent_ns = _measured(run, coding)
        except SwarmError as error:
            # once for each resource: the same values come at its rate
            if path not in self._refused:
                log.warning("%s is sent without its compression: %s", path, error)
            self._refused[path] = str(error)
            return run
        coded_size = sum(len(item.data) for item in coded)
        self._plain_bytes[path] += size
        self._coded_bytes[path] += coded_size
        self._spent_ns[path] += spent_ns
        # the oldest goes first: all subscribers of a value are served soon after each other
        while len(self._shared) >= SHARED:
            del self._shared[next(iter(self._shared))]
        self._shared[key] = coded
        return coded

    def plain(self, notify: TreeNotify) -> TreeNotify:
        """A received notification with its items as their owner wrote them; damaged ones are left out."""
        if not any(item.codec == CONTAINER for item in notify.items):
            return notify
        items: list[TreeItem] = []
        for found in decode(notify.items):
            if isinstance(found, WireError):
                with self._boundary(f"compressed items of {notify.platform}"):
                    raise found
            else:
                items.append(found)
        return msgspec.structs.replace(notify, items=tuple(items))


def _measured(run: Sequence[TreeItem], coding: Coding) -> tuple[list[TreeItem], int]:
    """Codes a run; with the processor time of the thread."""
    # processor time, not elapsed time: other threads share the processor meanwhile
    began_ns = thread_time_ns()
    if coding.compression.method is Method.JPEG:
        coded = [_as_jpeg(item, coding.compression.level) for item in run]
    else:
        coded = code(run, coding)
    return coded, thread_time_ns() - began_ns


def _as_jpeg(item: TreeItem, quality: int) -> TreeItem:
    image = registry.decode(Image, item.data)
    return msgspec.structs.replace(item, data=registry.encode(to_jpeg(image, quality)))
