"""Compressed items of notifications: items of one resource that are sent together make one container."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

import msgspec

from swarmd.tree.core.action import Coding
from swarmware.errors import WireError
from swarmware.model.compression import CONTAINER, Method, needs, pack, unpack
from swarmware.model.record_filter import NO_RECORDS, Layout, Records
from swarmware.types import registry
from swarmware.types.bounds import Count, Instant, Uint16
from swarmware.types.tree_exchange import TreeItem

SMALLEST: Final = 256
"""Bytes of values below which a container and the dictionary of its method cost more than they save."""
_PATH_BYTES: Final = 20


class RunItem(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One item of a run without its data."""

    kind: Uint16
    sequence: Count
    stamp_ns: Instant
    codec: Uint16
    size: Count


class ItemRun(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Items of one resource, in order."""

    items: tuple[RunItem, ...]
    data: bytes
    """The data of all, one after the other."""


_run_encoder = msgspec.msgpack.Encoder()
_run_decoder = msgspec.msgpack.Decoder(ItemRun)


def runs(items: Sequence[TreeItem]) -> Iterator[tuple[str, list[TreeItem]]]:
    """Items of the same resource that follow each other, with its path."""
    for path, group in groupby(items, key=lambda item: item.path):
        yield path, list(group)


def is_worth(items: Sequence[TreeItem], coding: Coding) -> bool:
    """Whether items may be coded: not small ones, and the subscriber must read the method."""
    method = coding.compression.method
    if method is Method.NONE or sum(len(item.data) for item in items) < SMALLEST:
        return False
    # a JPEG is a value of its own type, which needs no method at the receiver
    return method is Method.JPEG or needs(coding.compression) <= coding.reads


def code(items: Sequence[TreeItem], coding: Coding) -> list[TreeItem]:
    """The items in a container; as they are where that is not shorter."""
    first = items[0]
    run = ItemRun(
        tuple(RunItem(one.kind, one.sequence, one.stamp_ns, one.codec, len(one.data)) for one in items),
        b"".join(one.data for one in items),
    )
    records = _records(items, coding)
    data = pack(_run_encoder.encode(run), coding.compression, records, len(items))
    # one container also saves the paths of all items but one
    if len(data) >= len(run.data) + _PATH_BYTES * (len(items) - 1):
        return list(items)
    return [msgspec.structs.replace(first, data=data, codec=CONTAINER)]


def decode(items: Sequence[TreeItem]) -> Iterator[TreeItem | WireError]:
    """The items as their owner wrote them; an error for each container that is damaged."""
    for item in items:
        if item.codec != CONTAINER:
            yield item
            continue
        try:
            yield from _of_run(item)
        except WireError as error:
            yield WireError(f"{item.path}: {error}")


def _of_run(item: TreeItem) -> list[TreeItem]:
    try:
        run = _run_decoder.decode(unpack(item.data))
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise WireError(f"run of items: {error}") from error
    # checked before the items are cut: a wrong size would shift all that follow
    if sum(one.size for one in run.items) != len(run.data):
        raise WireError(f"run of {len(run.items)} items with {len(run.data)} bytes: its sizes differ")
    out, at = [], 0
    for one in run.items:
        data = run.data[at : at + one.size]
        at += one.size
        out.append(TreeItem(item.path, item.data_id, one.kind, one.sequence, one.stamp_ns, data, one.codec))
    return out


def _records(items: Sequence[TreeItem], coding: Coding) -> Records:
    """Records at the end of a run: the records of its only item, or packets of equal length."""
    first = items[0]
    # compressed or packed values have no records that a filter could use
    if any(item.codec for item in items):
        return NO_RECORDS
    records = registry.records(coding.type, first.data)
    if needs(coding.compression, records) - coding.reads:
        return NO_RECORDS
    if len(items) == 1:
        return records
    size = len(first.data)
    same = records.size == records.record_bytes and all(len(item.data) == size for item in items)
    if records.layout is not Layout.VLP16 or not same:
        return NO_RECORDS
    others = (registry.records(coding.type, item.data) for item in items[1:])
    return Records(Layout.VLP16, size, size * len(items)) if all(map(records.__eq__, others)) else NO_RECORDS
