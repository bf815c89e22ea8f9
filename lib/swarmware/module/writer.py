"""Writer of a board, event or stream."""

from typing import Final, Generic, TypeVar

import msgspec

from swarmware.errors import TypeMismatch
from swarmware.model.frame import HEADER_BYTES, Frame, FrameKind, encode
from swarmware.model.names import ANY
from swarmware.model.resource import Kind as ResourceKind
from swarmware.model.resource import Resource
from swarmware.node.node import Node
from swarmware.node.publication import Publication
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)

BOARD_SLOTS: Final = 4
BOARD_SLOT_BYTES: Final = 512
"""Default slot: a header and most values; the ring is replaced when a value is larger."""
FRAME_KINDS: Final = {
    ResourceKind.BOARD: FrameKind.BOARD,
    ResourceKind.SETTING: FrameKind.BOARD,
    ResourceKind.EVENT: FrameKind.EVENT,
    ResourceKind.STREAM: FrameKind.STREAM,
}


class BoardWriter(Generic[T]):
    """Publishes the values of one resource of this platform; each `write` wakes its readers."""

    def __init__(
        self, node: Node, app_id: int, resource: Resource, cls: type[T], publication: Publication
    ) -> None:
        self.resource = resource
        self.path = resource.path
        self.durable = False
        """Whether the newest value stays readable after the end of its writer, until the node ends."""
        self._cls = cls
        self._clock = node.clock
        self._publication = publication
        self._frame = Frame(
            FRAME_KINDS[resource.kind], resource.data_id, node.hardware, app_id, ANY, ANY
        )  # refilled for each value: a writer belongs to one thread
        self._encode = registry.encode

    @property
    def sequence(self) -> int:
        """Sequence of the newest value; it continues over restarts of the writer."""
        return self._publication.sequence

    def write(self, value: T, stamp_ns: int | None = None) -> int:
        """Publish a value, stamped now or with the instant given (node's hardware clock); its sequence.

        Raises: TypeMismatch, OutOfRange when it is too large for shared memory.
        """
        # exactly this class: a subclass would be encoded with further fields
        if type(value) is not self._cls:
            raise TypeMismatch(f"{self.path}: {type(value).__name__}, expected {self._cls.__name__}")
        frame = self._frame
        frame.sequence = self._publication.sequence + 1
        frame.stamp_ns = self._clock.now_ns() if stamp_ns is None else stamp_ns
        frame.payload = self._encode(value)
        return self._publication.publish(encode(frame))

    def loan(self, length: int, stamp_ns: int | None = None) -> "Loan":
        """An encoded payload, filled in place and published on leaving the `with` block."""
        frame = self._frame
        frame.sequence = self._publication.sequence + 1
        frame.stamp_ns = self._clock.now_ns() if stamp_ns is None else stamp_ns
        frame.payload = b""
        slot = self._publication.loan(HEADER_BYTES + length)
        # the header now, with an empty payload: its length is in the slot, not in the header
        slot[:HEADER_BYTES] = encode(frame)
        return Loan(self._publication, slot)

    def close(self, *, unlink: bool = True) -> None:
        """Stop publishing; without `unlink` the newest value stays readable until the node ends."""
        self._publication.close(unlink=unlink and not self.durable)


class Loan:
    """A slot of shared memory on loan until it is published."""

    def __init__(self, publication: Publication, slot: memoryview) -> None:
        self._publication = publication
        self._slot = slot
        self.payload = slot[HEADER_BYTES:]
        """The payload to be filled; invalid after the `with` block."""

    def __enter__(self) -> memoryview:
        return self.payload

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self.payload.release()
        if kind is None:
            self._publication.publish_loan()
        else:
            self._publication.abandon()
