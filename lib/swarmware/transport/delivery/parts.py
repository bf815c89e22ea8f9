"""Values larger than a frame: split by the sender, put together by the receiver, each part acknowledged.

The parts are frames of the kind of the whole with the flag `BULK`, so a large value delays nothing else.
"""

import struct
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.model.frame import Flag, Frame
from swarmware.transport.delivery.outcome import Outcome, Status

SPLIT_BYTES: Final = 64 * 1024
"""Payload above which a value to another computer is split."""
PART_BYTES: Final = 32 * 1024
"""Payload of a part: at 1 Mbit/s one takes 0.26 s."""
VALUE_LIMIT: Final = 64 * 1024 * 1024
"""Largest payload of a message."""
HELD_BYTES: Final = 2 * VALUE_LIMIT
"""Bytes of incomplete values that a process holds; further ones are refused."""
FORGET_NS: Final = 120_000_000_000
"""Time after which a value without a new part is forgotten."""

_TAG: Final = 8
_PART: Final = struct.Struct("<BBIHHI")
"""Element of a header extension: tag, length of what follows, sequence of the first part, number of this one,
number of parts, bytes of the whole."""
_LENGTH: Final = _PART.size - 2


class PartHeader(msgspec.Struct, frozen=True, gc=False):
    """Position of a frame's part in the split value."""

    first: int
    """Sequence of the frame with part 0."""
    number: int
    count: int
    total: int
    """Bytes of the whole."""

    def encode(self) -> bytes:
        """The element of the header extension."""
        return _PART.pack(_TAG, _LENGTH, self.first, self.number, self.count, self.total)


def part_header(extension: bytes) -> PartHeader | None:
    """The part that an extension states, or None if the frame is whole.

    Raises: WireError for a part that cannot be.
    """
    if _TAG not in extension:
        return None  # most frames: the search costs less than the loop
    at = 0
    while at + 2 <= len(extension):
        tag, length = extension[at], extension[at + 1]
        if tag == _TAG:
            if length != _LENGTH or at + _PART.size > len(extension):
                raise WireError(f"header extension: a part of {length} bytes; expected {_LENGTH}")
            found = PartHeader(*_PART.unpack_from(extension, at)[2:])
            if found.number >= found.count or found.total > VALUE_LIMIT or found.count > _count(found.total):
                raise WireError(f"part {found.number} of {found.count} of {found.total} bytes")
            return found
        at += 2 + length
    return None


def _count(total: int) -> int:
    return -(-total // PART_BYTES)


def parts_of(frame: Frame, next_sequence: Callable[[], int]) -> Iterator[Frame]:
    """The frames of the parts of a value, which is encoded in one; the first one has its sequence."""
    payload, count = memoryview(frame.payload), _count(len(frame.payload))
    for number in range(count):
        header = PartHeader(frame.sequence, number, count, len(payload))
        yield msgspec.structs.replace(
            frame,
            sequence=next_sequence() if number else frame.sequence,
            flags=frame.flags | int(Flag.BULK),
            extension=frame.extension + header.encode(),
            payload=bytes(payload[number * PART_BYTES : (number + 1) * PART_BYTES]),
        )


_Value = tuple[int, int, int, int]
"""Sender's hardware and application, data id, sequence of the first part."""


class _Incomplete:
    __slots__ = ("header", "parts", "size", "touched_ns")

    def __init__(self, header: PartHeader) -> None:
        self.header = header
        self.parts: dict[int, bytes] = {}
        self.size = 0
        self.touched_ns = 0


class PartAssembly:
    """The incomplete values of the addresses of a process."""

    def __init__(self, where: str, held_bytes: int = HELD_BYTES) -> None:
        self._where = where
        self._held_limit = held_bytes
        self._values: dict[_Value, _Incomplete] = {}
        self._held = 0

    @property
    def held_bytes(self) -> int:
        """Bytes of all incomplete values."""
        return self._held

    def on_frame(self, frame: Frame, take: Callable[[Frame], Outcome | None], now_ns: int) -> Outcome | None:
        """Take a frame of a message; `take` gets whole messages, and split ones with their last part.

        Returns the outcome of the frame, or None without room, so that its sender repeats it.
        """
        try:
            header = part_header(frame.extension)
        except WireError as error:
            return Outcome(Status.REFUSED, self._where, str(error))
        if header is None:
            return take(frame)
        key = (frame.sender_hw, frame.sender_app, frame.data_id, header.first)
        value = self._values.get(key)
        if value is None:
            self._forget(now_ns)
            if self._held + header.total > self._held_limit:
                detail = f"no room for a value of {header.total} bytes; {self._held} of others arrive"
                return Outcome(Status.REFUSED, self._where, detail)
            value = self._values[key] = _Incomplete(header)
            # The whole size counts from the first part on, so that a value that begins can also be
            # completed.
            self._held += header.total
        if (header.count, header.total) != (value.header.count, value.header.total):
            return Outcome(Status.REFUSED, self._where, "its parts do not fit each other")
        value.touched_ns = now_ns
        if header.number not in value.parts:
            value.parts[header.number] = bytes(frame.payload)
            value.size += len(frame.payload)
        if len(value.parts) < header.count:
            return Outcome(Status.DELIVERED, self._where, received_ns=now_ns)
        return self._complete(key, value, frame, take)

    def _complete(
        self, key: _Value, value: _Incomplete, last: Frame, take: Callable[[Frame], Outcome | None]
    ) -> Outcome | None:
        if value.size != value.header.total:
            self._drop(key)
            detail = f"parts of {value.size} bytes; expected {value.header.total}"
            return Outcome(Status.REFUSED, self._where, detail)
        payload = b"".join(value.parts[number] for number in range(value.header.count))
        outcome = take(msgspec.structs.replace(last, sequence=value.header.first, payload=payload))
        if outcome is None:
            del value.parts[part_number(last)]  # the sender repeats this part, which then completes the value
            value.size -= len(last.payload)
        else:
            self._drop(key)
        return outcome

    def _drop(self, key: _Value) -> None:
        self._held -= self._values.pop(key).header.total

    def _forget(self, now_ns: int) -> None:
        for key in [key for key, value in self._values.items() if now_ns - value.touched_ns > FORGET_NS]:
            self._drop(key)


def part_number(frame: Frame) -> int:
    """Number of the part in a frame that has one."""
    header = part_header(frame.extension)
    return 0 if header is None else header.number
