"""Requests and replies larger than a frame: the receiver's side.

A large request comes in parts, as a large message does; the reply to the part that completes it is its reply.
A large reply is held, and its caller requests one part after the other: so each part is repeated and
acknowledged as any request is.
"""

import struct
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.frame import HEADER_BYTES, PAYLOAD_LIMIT, Frame
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.delivery.parts import FORGET_NS, HELD_BYTES, PART_BYTES, VALUE_LIMIT, PartAssembly
from swarmware.types.rpc import Reply

TAKEN: Final = "part"
"""`Reply.kind` of an answer to a part of a request that is not complete yet."""
HELD: Final = "held"
"""`Reply.kind` of a reply that must be requested in parts; its body is the size."""
REPLY_MAX: Final = PAYLOAD_LIMIT - HEADER_BYTES - 64
"""Largest body of a reply that fits a frame, with what the reply itself adds."""

_SIZE: Final = struct.Struct("<I")
_TAG: Final = 9
_FETCH: Final = struct.Struct("<BBIH")
"""Element of a header extension: tag, length of what follows, sequence of the request whose reply is held,
number of the part."""
_LENGTH: Final = _FETCH.size - 2

_Origin = tuple[int, int, int, int]
"""Sender's hardware and application, data id, sequence."""


def fetch_element(sequence: int, number: int) -> bytes:
    """The element of a request for a part of the reply to the request with this sequence."""
    return _FETCH.pack(_TAG, _LENGTH, sequence, number)


def _fetched(extension: bytes) -> tuple[int, int] | None:
    """Sequence and number in a request for a part of a reply, or None for any other request.

    Raises: WireError for an element of another length.
    """
    at = 0
    while at + 2 <= len(extension):
        tag, length = extension[at], extension[at + 1]
        if tag == _TAG:
            if length != _LENGTH or at + _FETCH.size > len(extension):
                raise WireError(f"header extension: a part of a reply of {length} bytes; expected {_LENGTH}")
            _, _, sequence, number = _FETCH.unpack_from(extension, at)
            return sequence, number
        at += 2 + length
    return None


def held_bytes(reply: Reply) -> int | None:
    """Size of a reply's body that must be requested in parts, or None if the reply is whole.

    Raises: WireError for a size that no reply has.
    """
    if not reply.ok or reply.kind != HELD:
        return None
    size = int(_SIZE.unpack(reply.body)[0]) if len(reply.body) == _SIZE.size else 0
    if not REPLY_MAX < size <= VALUE_LIMIT:
        raise WireError(f"a reply of {size} bytes in parts: expected {REPLY_MAX + 1} to {VALUE_LIMIT}")
    return size


def part_count(size: int) -> int:
    """Number of the parts of a held reply."""
    return -(-size // PART_BYTES)


class _HeldReply(msgspec.Struct):
    body: bytes
    touched_ns: int


class LargeRequests:
    """Incomplete requests, and replies whose callers request their parts."""

    def __init__(self, parts: PartAssembly, held_limit: int = HELD_BYTES) -> None:
        self._parts = parts
        self._held_limit = held_limit
        self._held: dict[_Origin, _HeldReply] = {}
        self._held_bytes = 0

    def on_request(self, frame: Frame, now_ns: int) -> Frame | Reply:
        """Take a frame of a request: the whole request, or the reply to this frame alone."""
        try:
            fetched = _fetched(frame.extension)
        except WireError as error:
            return Reply(False, kind="WireError", error=str(error))
        if fetched is not None:
            return self._part(frame, *fetched, now_ns)
        whole: list[Frame] = []

        def take(request: Frame) -> Outcome:
            whole.append(request)
            return Outcome(Status.DELIVERED)

        outcome = self._parts.on_frame(frame, take, now_ns)
        if whole:
            # assembled from parts, it is served as one frame
            return whole[0]
        if outcome:
            return Reply(True, kind=TAKEN)
        return Reply(False, kind="OutOfRange", error="" if outcome is None else outcome.detail)

    def on_reply(self, frame: Frame, reply: Reply, now_ns: int) -> Reply:
        """The reply to a request as it is sent: whole if it fits a frame."""
        size = len(reply.body)
        # a reply that is too large is refused by the router, with a reason
        if size <= REPLY_MAX or size > VALUE_LIMIT:
            return reply
        self._forget(now_ns)
        # the oldest goes first: its caller has most likely given up
        while self._held and self._held_bytes + size > self._held_limit:
            self._drop(next(iter(self._held)))
        self._held[_origin(frame, frame.sequence)] = _HeldReply(reply.body, now_ns)
        self._held_bytes += size
        return Reply(True, _SIZE.pack(size), HELD)

    def _part(self, frame: Frame, sequence: int, number: int, now_ns: int) -> Reply:
        held = self._held.get(_origin(frame, sequence))
        if held is None:
            return Reply(False, kind="NoAnswer", error="the reply is no longer held")
        # a slow link must not lose the reply between two of its parts
        held.touched_ns = now_ns
        return Reply(True, held.body[number * PART_BYTES : (number + 1) * PART_BYTES])

    def _forget(self, now_ns: int) -> None:
        for origin in [key for key, one in self._held.items() if now_ns - one.touched_ns > FORGET_NS]:
            self._drop(origin)

    def _drop(self, origin: _Origin) -> None:
        self._held_bytes -= len(self._held.pop(origin).body)


def _origin(frame: Frame, sequence: int) -> _Origin:
    return frame.sender_hw, frame.sender_app, frame.data_id, sequence
