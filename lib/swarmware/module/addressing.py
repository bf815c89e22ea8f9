"""Frames to addresses: receiver, payload type, and a sequence per address."""

import os
from collections.abc import Iterator
from functools import partial
from typing import Final

import msgspec

from swarmware.errors import OutOfRange
from swarmware.model import names
from swarmware.model.frame import ADDRESSED, PAYLOAD_LIMIT, Frame, FrameKind
from swarmware.module.node_participant import NodeParticipant
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.parts import SPLIT_BYTES, VALUE_LIMIT, parts_of
from swarmware.types import registry

_SPLIT: Final = ADDRESSED | {FrameKind.REQUEST}
ADDRESSES_MAX: Final = 4096
"""Addresses that are kept between two messages to them."""


class Recipient:
    """A path for values of one type, on this or another platform, and the computer that takes them now."""

    def __init__(self, participant: NodeParticipant, path: str, cls: type[msgspec.Struct]) -> None:
        self.platform, self._name = names.split(participant.local(path))
        """Platform or computer, or None for the own platform or this computer."""
        self.data_id = names.data_id(self._name, registry.type_name(cls))
        node = participant.node
        self._here = node.hardware
        stays = self.platform is None and names.has_unit_branch(self._name)
        self._is_fixed = stays or "." in (names.split(path)[0] or "")
        self._own = node.platform
        self._default = node.hardware if self.platform is None else names.hardware_id(self.platform)
        self._units = participant.units
        self._table = participant.node.table

    @property
    def hardware(self) -> int:
        """Receiver of its frames: this computer where an application of it serves the path, else another."""
        if self._is_fixed:
            return self._default
        platform = self.platform or self._own
        # most platforms have one computer, and need no search for the right one
        if not self._units.has_several(platform):
            return self._default
        if self.platform is None:
            self._table.refresh()
            if self._table.serving_path(self._name) is not None:
                return self._default
        unit = self._units.serving(platform, self._name)
        return self._default if unit is None else unit.hardware

    def mismatch(self) -> str:
        """Reason why a local address does not accept this type, or "" if it does or is not served yet."""
        if self.hardware != self._here:
            return ""
        self._table.refresh()
        if self._table.serving(self.data_id) is not None:
            return ""
        found = self._table.serving_path(self._name)
        return "" if found is None else f"{self._name} of {found[0].id} takes {found[1].type}"


class Addressing:
    """Makes the frames of one application; each address has a sequence of its own."""

    def __init__(self, participant: NodeParticipant) -> None:
        self._participant = participant
        self._hardware = participant.node.hardware
        self._app_id = participant.app_id
        self._clock = participant.node.clock
        self._sequences: dict[int, int] = {}
        self._addresses: dict[tuple[str, type[msgspec.Struct]], Recipient] = {}

    def address(self, path: str, cls: type[msgspec.Struct]) -> Recipient:
        """The address for values of this type.

        Raises: InvalidInput when it is not a path.
        """
        address = self._addresses.get((path, cls))
        if address is None:
            address = Recipient(self._participant, path, cls)
            # A module may send to paths made of data; the oldest address can be made again.
            while len(self._addresses) >= ADDRESSES_MAX:
                del self._addresses[next(iter(self._addresses))]
            self._addresses[path, cls] = address
        return address

    def frame(self, kind: FrameKind, address: Recipient, value: msgspec.Struct, timeout_s: float) -> Frame:
        """A frame with the value, to be delivered within the time; a message's frame may need to be split.

        Raises: OutOfRange when the value is too large.
        """
        payload = registry.encode(value)
        limit = VALUE_LIMIT if kind in _SPLIT else PAYLOAD_LIMIT
        if len(payload) > limit:
            raise OutOfRange(f"a value of {len(payload)} bytes: expected at most {limit}")
        # a random start: messages of a restarted application must not look like duplicates
        sequence = self._sequences.get(address.data_id)
        sequence = int.from_bytes(os.urandom(4)) if sequence is None else (sequence + 1) & 0xFFFF_FFFF
        self._sequences[address.data_id] = sequence
        return Frame(
            kind,
            address.data_id,
            self._hardware,
            self._app_id,
            address.hardware,
            names.ANY,
            sequence,
            self._clock.now_ns(),
            extension=with_lifetime(timeout_s),
            payload=payload,
        )

    def parts(self, frame: Frame) -> Iterator[Frame] | None:
        """The frames of the parts of a message or request, or None if one frame is enough."""
        # inside a node a large frame costs nothing; on a link it would block others
        is_split = frame.kind is not FrameKind.REQUEST and frame.receiver_hw != self._hardware
        limit = SPLIT_BYTES if is_split else PAYLOAD_LIMIT
        if len(frame.payload) <= limit:
            return None
        return parts_of(frame, partial(self._next_sequence, frame.data_id))

    def again(self, question: Frame, element: bytes) -> Frame:
        """A request without content to the address of another one, with a further element of extension."""
        return msgspec.structs.replace(
            question,
            sequence=self._next_sequence(question.data_id),
            stamp_ns=self._clock.now_ns(),
            extension=question.extension + element,
            payload=b"",
        )

    def _next_sequence(self, data_id: int) -> int:
        sequence = self._sequences[data_id] = (self._sequences[data_id] + 1) & 0xFFFF_FFFF
        return sequence
