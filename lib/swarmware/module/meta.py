"""Metadata of a received value: sender and stamp."""

import msgspec

from swarmware.model.access import Sender
from swarmware.model.frame import Frame
from swarmware.transport.delivery.sender import sender_and_arrival_ns


class Meta(msgspec.Struct, frozen=True, gc=False):
    """Sender and times in the header of a frame."""

    sender_hw: int
    """Hardware id, see `names.hardware_id`."""
    sender_app: int
    sequence: int
    stamp_ns: int
    """Stamp on the sender's hardware clock."""
    sender: Sender | None = None
    """The authenticated member, or None for an application of this platform or a swarm without keys."""
    arrived_ns: int | None = None
    """Own hardware clock when this platform's broker received it from a link, or None without a link."""

    @classmethod
    def of(cls, frame: Frame) -> "Meta":
        """The metadata of a frame."""
        sender, arrived_ns = sender_and_arrival_ns(frame.extension) if frame.extension else (None, None)
        return cls(frame.sender_hw, frame.sender_app, frame.sequence, frame.stamp_ns, sender, arrived_ns)
