"""Channels of the bytes of a frame: its resource where known, else its kind."""

from collections.abc import Callable
from typing import Final

from swarmware.errors import WireError
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import data_id
from swarmware.types import registry
from swarmware.types.tree import TreeNotify

NOTIFY_ID: Final = data_id("sys/tree/notify", TreeNotify.__name__)
NOTIFIES: Final = frozenset({FrameKind.NOTIFY, FrameKind.STREAM, FrameKind.EVENT})


def shares(frame: Frame, path_of: Callable[[int], str | None]) -> list[tuple[str, int]]:
    """Channels and payload bytes of a frame; those of a tree notification are counted by item."""
    size = len(frame.payload)
    if frame.data_id == NOTIFY_ID and frame.kind in NOTIFIES:
        try:
            note = registry.decode(TreeNotify, frame.payload, frame.codec)
        except WireError:
            note = None  # the receiver will refuse it
        if note is not None and note.items:
            parts = [(item.path, len(item.data)) for item in note.items]
            return [*parts, ("sys/tree/notify", size - sum(part for _, part in parts))]
    if frame.kind in {FrameKind.ACK, FrameKind.HELLO}:
        return [(frame.kind.name.lower(), size)]
    return [(path_of(frame.data_id) or frame.kind.name.lower(), size)]


def values_in(frame: Frame) -> int:
    """Number of notified values in a frame."""
    if frame.kind not in NOTIFIES:
        return 0
    if frame.data_id != NOTIFY_ID:
        return 1
    try:
        return len(registry.decode(TreeNotify, frame.payload, frame.codec).items)
    except WireError:
        return 0
