"""Actions of reliable links for their shell."""

import msgspec

from swarmd.broker.core.frames.send_queue import QueuedFrame


class SendPacket(msgspec.Struct, frozen=True, gc=False):
    """Action: seal this packet and send it to the neighbour, if this is its present session."""

    hw: int
    session: int
    data: bytes


class DeliverFrame(msgspec.Struct, frozen=True, gc=False):
    """Action: take an encoded frame of the neighbour."""

    hw: int
    data: bytes


class FrameBegun(msgspec.Struct, frozen=True, gc=False):
    """Action: count a frame that is being sent for the first time."""

    hw: int
    queued: QueuedFrame


class FramesDropped(msgspec.Struct, frozen=True, gc=False):
    """Action: refuse these frames to their senders: the neighbour does not take them."""

    hw: int
    frames: list[QueuedFrame]


LinkAction = SendPacket | DeliverFrame | FrameBegun | FramesDropped
