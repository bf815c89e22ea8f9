"""Who sent a value and when."""

import msgspec

from swarmware.model.access import Sender
from swarmware.model.frame import Frame
from swarmware.transport.delivery.sender import arrival_ns, sender_of


class Meta(msgspec.Struct, frozen=True, gc=False):
    """What the header of a frame says about its sender."""

    sender_hw: int
    """Hardware id, see `names.hardware_id`."""
    sender_app: int
    sequence: int
    stamp_ns: int
    """On the sender's hardware clock."""
    sender: Sender | None = None
    """The member it came from; None: an application of this platform, or a swarm without keys."""
    arrived_ns: int | None = None
    """Own hardware clock when this platform's broker took it off a link; None: it crossed none."""

    @classmethod
    def of(cls, frame: Frame) -> "Meta":
        """The sender of a frame."""
        return cls(
            frame.sender_hw,
            frame.sender_app,
            frame.sequence,
            frame.stamp_ns,
            sender_of(frame.extension) if frame.extension else None,
            arrival_ns(frame.extension) if frame.extension else None,
        )
