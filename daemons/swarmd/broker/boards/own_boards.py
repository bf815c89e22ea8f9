"""Boards of this node in shared memory, of which the beacon takes the newest values."""

import logging
from typing import Final

from swarmd.broker.core.beacon.beacon import BODY_LIMIT, NEVER_NS
from swarmd.broker.core.beacon.beacon_codec import value_bytes
from swarmd.broker.core.boards.published_boards import PublishedBoard, PublishedBoards
from swarmd.broker.core.traffic import Counters
from swarmware.errors import NotFound, WireError
from swarmware.model.frame import Codec, Frame
from swarmware.node.follower import RingFollower
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry

VALUE_LIMIT: Final = BODY_LIMIT - 200
"""Largest value, which must fit beside a hello and some rows."""
LOOK_AGAIN_NS: Final = 500_000_000
"""Period of the attempts to open a ring that does not exist yet."""

log = logging.getLogger("swarm.broker")


class OwnBoards:
    """Reads the newest values of the own boards from shared memory."""

    def __init__(self, node: Node, published: PublishedBoards, counters: Counters) -> None:
        self._node = node
        self._published = published
        self._counters = counters
        self._followers: dict[int, RingFollower] = {}
        self._seen: dict[int, int] = {}
        """Position of each board's newest value that was taken."""
        self._look_ns = NEVER_NS
        self._too_large: set[str] = set()

    def poll(self, now_ns: int) -> None:
        """Puts values that changed since the last beacon into the published boards."""
        boards = self._published.boards
        for data_id in [known for known in self._followers if known not in boards]:
            self._followers.pop(data_id).close()
            del self._seen[data_id]
        look = now_ns >= self._look_ns
        if look:
            self._look_ns = now_ns + LOOK_AGAIN_NS
        for data_id, board in boards.items():
            follower = self._followers.get(data_id)
            if follower is None:
                follower = self._followers[data_id] = RingFollower(
                    ring_file(self._node.shm_dir, board.path), name=f"board {board.path}", data_id=data_id
                )
                self._seen[data_id] = 0
            ring = follower.ring
            if look if ring is None else not ring.unchanged:
                self._take(follower, board)

    def _take(self, follower: RingFollower, board: PublishedBoard) -> None:
        frame = follower.newest()
        if frame is None:
            return
        before, self._seen[board.data_id] = self._seen[board.data_id], follower.given
        try:
            payload, packed = _wire_form(board.type, frame)
        except WireError as error:
            follower.refuse(error)
            return
        channel = self._counters.channel(board.path)
        changes = max(1, follower.given - before) if before else 1
        channel.offered_frames += changes
        channel.offered_bytes += changes * len(payload)
        if value_bytes(payload) > VALUE_LIMIT:
            channel.dropped += changes
            if board.path not in self._too_large:
                self._too_large.add(board.path)
                log.warning("board %s: %d bytes do not fit into a beacon", board.path, len(payload))
            return
        board.put(payload, packed, frame.stamp_ns)

    def close(self) -> None:
        """Stop reading and close all rings."""
        for follower in self._followers.values():
            follower.close()
        self._followers.clear()


def _wire_form(type_name: str, frame: Frame) -> tuple[bytes, bool]:
    """The payload in its wire form, and whether that is the type's quantised form."""
    payload = bytes(frame.payload)
    if frame.codec is Codec.PACKED:
        return payload, True
    if frame.codec is not Codec.NONE:
        payload = registry.decompress(payload, frame.codec)
    try:
        cls = registry.find(type_name)
    except NotFound:
        return payload, False  # the type is not installed here, so the value is sent unchanged
    if not hasattr(cls, "unpack"):
        return payload, False
    packed, codec = registry.pack(registry.decode(cls, payload))
    return packed, codec is Codec.PACKED
