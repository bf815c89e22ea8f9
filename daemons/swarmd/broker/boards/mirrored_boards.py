"""Boards of other platforms from received beacons, written to the rings that their readers on this node
open."""

import logging

from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.traffic import Counters
from swarmware.errors import SwarmError, WireError
from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.types.net import BoardSubscription

log = logging.getLogger("swarm.broker")


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
