"""Boards in shared memory: own ones, whose newest values the beacon takes, and mirrors of received ones."""

import logging
from typing import Final

from swarmd.broker.core.beacon.beacon import BODY_LIMIT, NEVER_NS
from swarmd.broker.core.beacon.beacon_codec import value_bytes
from swarmd.broker.core.boards.published_boards import PublishedBoard, PublishedBoards
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.traffic import Counters
from swarmware.errors import NotFound, SwarmError, WireError
from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.node.follower import RingFollower
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry
from swarmware.types.net import BoardSubscription

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


class MirroredBoards:
    """Writes values from beacons to the mirrors of the boards that this node subscribes to."""

    def __init__(self, mirrors: MirrorWriter, counters: Counters) -> None:
        self._mirrors = mirrors
        self._counters = counters
        self._complained: set[tuple[str, str]] = set()

    def write(self, want: BoardSubscription, value: RemoteValue) -> bool:
        """Write one value; False when that failed."""
        frame = Frame(
            FrameKind.BOARD,
            want.data_id,
            value.origin_hw,
            stamp_ns=value.stamp_us * 1000,
            # our clock when the value was made, from the ages on the way: accurate enough to
            # judge its age where the origin's clock is not known yet
            echo_rx_us=value.rx_ns // 1000 - value.age_us,
            codec=Codec.PACKED if value.packed else Codec.NONE,
            payload=value.payload,
        )
        try:
            return self._mirrors.write(want.platform, want.path, frame)
        except SwarmError as error:
            self._counters.refused.malformed += isinstance(error, WireError)
            self._complain(want, error)
            return False

    def _complain(self, want: BoardSubscription, error: SwarmError) -> None:
        key = (want.platform, want.path)
        if key not in self._complained:  # once, not with each beacon
            self._complained.add(key)
            log.warning("mirror of /%s/%s: %s", *key, error)

    def keep_only(self, wants: tuple[BoardSubscription, ...]) -> None:
        """Remove the mirrors of boards that are no longer subscribed."""
        self._mirrors.keep_only((want.platform, want.path) for want in wants)

    def close(self) -> None:
        """Stop writing; the newest values stay readable."""
        self._mirrors.close()


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
