"""A ring that this process writes, and the notifier of its readers."""

from pathlib import Path
from typing import Final

from swarmware.errors import OutOfRange
from swarmware.transport.shm.doorbell import DoorbellSenders
from swarmware.transport.shm.layout import MAX_SLOT_BYTES, readers_folder
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingWriter
from swarmware.transport.shm.ringfile import EpochPosition

ALIGN: Final = 256
"""Slots grow in steps of this many bytes."""


class Publication:
    """Publishes frames; its ring is replaced by one of larger slots when a frame does not fit."""

    def __init__(
        self,
        path: Path,
        doorbells: DoorbellSenders,
        *,
        slots: int,
        slot_bytes: int,
        mode: int = 0o640,
        readers_of: Path | None = None,
    ) -> None:
        """`readers_of`: ring whose readers are notified, or None for the own ring."""
        self.path = path
        self.folder = str(path.parent)
        self._mode = mode
        self._slots = slots
        self._ring = RingWriter(path, slots=slots, slot_bytes=slot_bytes, mode=mode)
        self._resume: EpochPosition | None = None
        """Position from which the replacement of a damaged ring continues."""
        self._newest: bytes | bytearray | None = None
        """The newest frame written by this object, or None for a loan or before the first."""
        self._readers = ReaderNotifier(readers_folder(readers_of or path), doorbells)
        self._readers.notify()  # readers may be waiting for a writer

    @property
    def sequence(self) -> int:
        """Ring sequence of the newest frame; it continues over restarts of the writer."""
        return self._ring.sequence

    def publish(self, data: bytes | bytearray) -> int:
        """Publish one encoded frame and wake its readers; returns the ring sequence.

        A bytearray may be changed afterwards, for the next frame only.
        """
        if self._resume is not None:
            self._replace()
        if len(data) > self._ring.slot_bytes:
            self._grow(len(data))
        sequence = self._ring.write(data)
        self._newest = data
        self._readers.notify()
        return sequence

    def loan(self, length: int) -> memoryview:
        """The bytes of the next frame, to be filled in place; nothing is visible before `publish_loan`."""
        if self._resume is not None:
            self._replace()
        if length > self._ring.slot_bytes:
            self._grow(length)
        return self._ring.loan(length)

    def publish_loan(self) -> int:
        """Publish the frame on loan and wake the readers."""
        sequence = self._ring.publish()
        self._newest = None
        self._readers.notify()
        return sequence

    def abandon(self) -> None:
        """Return the slot on loan without publishing it."""
        self._ring.abandon()

    def _grow(self, length: int) -> None:
        # At least doubled, so that slowly growing values do not replace the ring at each write.
        slot_bytes = max(2 * self._ring.slot_bytes, -(-length // ALIGN) * ALIGN)
        # before the ring is closed, so that a value that is too large changes nothing
        if length > MAX_SLOT_BYTES:
            raise OutOfRange(f"{self.path}: a frame of {length} bytes; expected at most {MAX_SLOT_BYTES}")
        self._ring.close()  # it stays readable until the new file replaces it
        self._ring = RingWriter(
            self.path, slots=self._slots, slot_bytes=min(slot_bytes, MAX_SLOT_BYTES), mode=self._mode
        )

    def tend(self, *, at_path: bool = False) -> bool:
        """Replace the ring if its file was damaged or removed; returns whether it was.

        `at_path`: its folder has not changed since a check that found the file.
        The newest frame is copied to the new file with its sequence: a writer of changes only would not
        write it again, and readers that have read it do not get it twice.
        Raises: as the constructor; it is then retried with the next frame.
        """
        if self._resume is None:
            # most checks end here
            if self._ring.intact(at_path=at_path):
                return False
            self._resume = self._ring.discard()
        self._replace()
        return True

    def _replace(self) -> None:
        resume, newest = self._resume, self._newest
        if resume is not None and newest is not None:
            epoch, sequence = resume
            # The newest frame is written again below, with the sequence that its readers know.
            resume = (epoch, sequence - 1)
        self._ring = RingWriter(
            self.path, slots=self._slots, slot_bytes=self._ring.slot_bytes, mode=self._mode, resume=resume
        )
        if newest is not None:
            self._ring.write(newest)
        self._resume = None
        self._readers.notify()

    def close(self, *, unlink: bool = True) -> None:
        """Stop writing; without `unlink` the newest frames stay readable until the node ends."""
        # before the bell, so that woken readers see the end
        self._ring.close(unlink=unlink)
        self._readers.notify()
        self._readers.close()
