"""Answer frames, and the lifetime that a message carries in its header extension."""

import struct
from functools import lru_cache
from typing import Final

from swarmware.model.frame import ADDRESSED, HOPS, Flag, Frame, FrameKind
from swarmware.transport.delivery.outcome import Status
from swarmware.types.registry import encode
from swarmware.types.rpc import Ack
from swarmware.types.time import Conversion

_QUESTIONS: Final = frozenset({FrameKind.MESSAGE, FrameKind.REQUEST})
ANSWERS: Final = frozenset({FrameKind.ACK, FrameKind.REPLY})
"""Kinds of frames that answer a message or request."""
_PRIORITY: Final = int(Flag.URGENT | Flag.BULK)
"""Flags of a question that its answer has, too."""
BOUND_SHARE: Final = 4
"""An error bound counts for at most this fraction of a lifetime."""
_LIFETIME_TAG = 1
_LIFETIME = struct.Struct("<BBI")
"""Element of a header extension: tag, length of what follows, lifetime in ms from the header's stamp."""


def answerable(frame: Frame) -> bool:
    """Whether the sender of a frame waits for its outcome."""
    return frame.kind in _QUESTIONS or (frame.kind in ADDRESSED and frame.wants_ack)


def answer(
    question: Frame,
    status: Status,
    *,
    where: str,
    detail: str = "",
    stamp_ns: int,
    received_ns: int = 0,
) -> Frame:
    """The acknowledgement or refusal of a message or request; any hop may give one for the receiver."""
    return reply(question, FrameKind.ACK, encode(Ack(int(status), where, detail, received_ns)), stamp_ns)


def reply(question: Frame, kind: FrameKind, payload: bytes, stamp_ns: int) -> Frame:
    """The frame of an answer: sender and receiver swapped, data id and sequence of the question."""
    return Frame(
        kind,
        question.data_id,
        question.receiver_hw,
        question.receiver_app,
        question.sender_hw,
        question.sender_app,
        question.sequence,
        stamp_ns,
        flags=question.flags & _PRIORITY,
        hops_left=HOPS,
        payload=payload,
    )


@lru_cache(maxsize=256)
def with_lifetime(timeout_s: float) -> bytes:
    """Header extension of a message that must not be delivered later than this after its stamp."""
    return _LIFETIME.pack(_LIFETIME_TAG, 4, min(max(0, round(timeout_s * 1000)), 0xFFFF_FFFF))


def lifetime_ns(extension: bytes) -> int | None:
    """Lifetime in a header extension, or None without a lifetime or a list of tagged elements."""
    at = 0
    while at + 2 <= len(extension):
        tag, length = extension[at], extension[at + 1]
        if tag == _LIFETIME_TAG and length == 4 and at + 6 <= len(extension):
            return int(_LIFETIME.unpack_from(extension, at)[2]) * 1_000_000
        at += 2 + length
    return None


def expired(frame: Frame, sender_now_ns: int) -> bool:
    """Whether the lifetime of a message is over, at a time of the clock that stamped it."""
    lifetime = lifetime_ns(frame.extension)
    return lifetime is not None and sender_now_ns > frame.stamp_ns + lifetime


def expired_here(frame: Frame, now_ns: int, conversion: Conversion | None) -> bool:
    """Whether the lifetime of another unit's message may be over, at a time of the own clock.

    Its sender reports `expired` at that instant, so a later hop must not deliver it: the error bound of
    the conversion counts against the message. Without a conversion (None) the sender's clock is unknown.
    """
    lifetime = lifetime_ns(frame.extension)
    # an unknown clock must not make every message expire
    if lifetime is None or conversion is None or conversion.suspect:
        return False
    over_ns = conversion.to_local(frame.stamp_ns + lifetime)
    # a bound as large as the lifetime must not expire all messages of a unit with an inaccurate clock
    return now_ns > over_ns - min(conversion.bound_at_ns(over_ns), lifetime // BOUND_SHARE)
