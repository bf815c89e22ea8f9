"""The layout of a ring file: offsets of its words, and permitted sizes.

All words are unsigned 64-bit, native order, aligned to 8 bytes, read and written one at a time through a
memoryview cast to 'Q': that is one machine instruction, so a word is never read partially. (`struct` with
'<Q' writes byte by byte and would break this.)

    header   256 bytes, words as below
    slots    `slots` times `stride` bytes: word BEFORE, word AFTER, word META, one spare word, then the bytes

A writer of sequence n sets BEFORE = n, the bytes, META, AFTER = n, and last NEWEST = n. A reader reads in the
opposite order: AFTER, the bytes, BEFORE. Both are n, or the bytes are torn.
"""

import zlib
from pathlib import Path

import msgspec

from swarmware.errors import Conflict, OutOfRange, SwarmError, WireError
from swarmware.transport.shm.owner import Owner

MAGIC = int.from_bytes(b"SWARMRNG", "little")
VERSION = 1
HEADER_BYTES = 256

# header words; MAGIC, VERSION and MOVED keep their places in every later version
W_MAGIC, W_VERSION = 0, 1
W_MOVED = 2
"""Not 0: this file is being or was replaced at its path; reopen the path."""
W_SLOTS, W_SLOT_BYTES = 3, 4
W_NONCE = 5
"""Random number of the file, which proves that a process shares this memory with the writer."""
W_EPOCH = 6
"""Random; a file that replaces another inherits it: sequences of one epoch never start again."""
W_FIRST = 7
"""Sequence before the first one in this file."""
W_STATIC_CRC = 8
STATIC_BYTES = 8 * (W_STATIC_CRC + 1)
"""The words up to here never change while the file is at its path."""
W_PID, W_START, W_BOOT_LOW, W_BOOT_HIGH = 9, 10, 11, 12
W_NEWEST = 16
"""Sequence of the newest complete frame, on a cache line of its own; equal to W_FIRST: none yet."""

_STATIC_WORDS = (W_MAGIC, W_VERSION, W_SLOTS, W_SLOT_BYTES, W_NONCE, W_EPOCH, W_FIRST)

# slot words, counted from the slot's start
S_BEFORE, S_AFTER, S_META = range(3)
SLOT_HEADER_BYTES = 32
"""Size of a slot's header: it aligns the frame to 32 bytes, and a payload behind a frame header to 16."""
LINE_BYTES = 64
"""Cache line: two slots never share one."""

CHECKED_SLOT_BYTES = 64 * 1024
"""Up to this size a slot carries a CRC-32 of its bytes; above, it would take longer than the copy."""
MIN_SLOTS = 4
"""Minimum slots: a reader of the newest frame has the time of three writes."""
MAX_SLOTS = 1 << 16
MAX_SLOT_BYTES = 64 << 20
"""Eight uncompressed camera frames of 1920 × 1080 pixels and 4 bytes."""
MAX_RING_BYTES = 1 << 30
LENGTH_MASK = 0xFFFF_FFFF
"""META: length of the frame in the lower half, its checksum in the upper."""
SEED_MASK = 0xFFFF_FFFF
"""The checksum starts with the sequence, so that bytes of another round do not match."""

RING_SUFFIX = ".ring"
READERS_SUFFIX = ".readers"
UNFINISHED_SUFFIX = ".new"


class RingBusy(Conflict):
    """Another living process writes this ring."""


class RingFull(SwarmError):
    """The file system of the shared memory, or the table of readers, is full."""


class Geometry(msgspec.Struct, frozen=True):
    """Number and size of the slots of a ring."""

    slots: int
    slot_bytes: int
    """Maximum size of a frame."""

    def check(self, where: Path) -> None:
        """Check the geometry against the limits of a ring.

        Raises: OutOfRange.
        """
        if not MIN_SLOTS <= self.slots <= MAX_SLOTS:
            raise OutOfRange(f"{where}: {self.slots} slots, expected {MIN_SLOTS} to {MAX_SLOTS}")
        if not 1 <= self.slot_bytes <= MAX_SLOT_BYTES:
            raise OutOfRange(f"{where}: slots of {self.slot_bytes} bytes, expected 1 to {MAX_SLOT_BYTES}")
        if self.file_bytes > MAX_RING_BYTES:
            raise OutOfRange(f"{where}: a ring of {self.file_bytes} bytes, expected at most {MAX_RING_BYTES}")

    @property
    def stride(self) -> int:
        """Bytes from one slot to the next."""
        return -(-(SLOT_HEADER_BYTES + self.slot_bytes) // LINE_BYTES) * LINE_BYTES

    @property
    def file_bytes(self) -> int:
        return HEADER_BYTES + self.slots * self.stride

    @property
    def checked(self) -> bool:
        """Whether the slots carry a CRC-32."""
        return self.slot_bytes <= CHECKED_SLOT_BYTES


def static_crc(words: memoryview) -> int:
    """Checksum of the words that never change in the life of a file."""
    return zlib.crc32(b"".join(words[i].to_bytes(8, "little") for i in _STATIC_WORDS))


def write_header(words: memoryview, geometry: Geometry, *, nonce: int, epoch: int, first: int) -> None:
    """Write the header of a file that is not visible to others yet; its first frame will be first + 1."""
    words[W_MAGIC] = MAGIC
    words[W_VERSION] = VERSION
    words[W_SLOTS] = geometry.slots
    words[W_SLOT_BYTES] = geometry.slot_bytes
    words[W_NONCE] = nonce
    words[W_EPOCH] = epoch
    words[W_FIRST] = first
    # after the words that it covers
    words[W_STATIC_CRC] = static_crc(words)
    words[W_NEWEST] = first


def read_header(words: memoryview, file_bytes: int, where: Path) -> Geometry:
    """Check the header of a file from outside.

    Raises: WireError for any invalid bytes.
    """
    if words[W_MAGIC] != MAGIC:
        raise WireError(f"{where}: not a ring, expected a file that starts with SWARMRNG")
    if words[W_VERSION] != VERSION:
        raise WireError(f"{where}: ring layout {words[W_VERSION]}, expected {VERSION}")
    # before the numbers are used as sizes and offsets
    if words[W_STATIC_CRC] != static_crc(words):
        raise WireError(f"{where}: the header of the ring is damaged")
    geometry = Geometry(words[W_SLOTS], words[W_SLOT_BYTES])
    try:
        geometry.check(where)
    except OutOfRange as error:
        raise WireError(str(error)) from error
    if file_bytes != geometry.file_bytes:
        raise WireError(f"{where}: {file_bytes} bytes, expected {geometry.file_bytes}")
    return geometry


def read_owner(words: memoryview) -> Owner:
    """The owner in the header; pid 0 while it is being written."""
    pid = words[W_PID]
    owner = Owner(pid, words[W_START], words[W_BOOT_HIGH] << 64 | words[W_BOOT_LOW])
    # read twice: a change in between shows in the pid, which is written last
    return owner if words[W_PID] == pid else Owner(0, 0, 0)


def write_owner(words: memoryview, owner: Owner) -> None:
    """Replace the owner; a kill in between leaves pid 0, never a mixture."""
    words[W_PID] = 0
    words[W_START] = owner.start_ticks
    words[W_BOOT_LOW] = owner.boot_id & 0xFFFF_FFFF_FFFF_FFFF
    words[W_BOOT_HIGH] = owner.boot_id >> 64
    words[W_PID] = owner.pid


def ring_file(shm_dir: Path, local_path: str, platform: str | None = None) -> Path:
    """Path of a resource's ring: `nav/pose` → `nav.pose.ring`; of another platform, in its folder."""
    folder = shm_dir if platform is None else shm_dir / platform
    return folder / (local_path.replace("/", ".") + RING_SUFFIX)


def ring_path(ring: Path) -> str:
    """Local path of the resource of a ring file: the inverse of `ring_file`."""
    return ring.name.removesuffix(RING_SUFFIX).replace(".", "/")


def readers_folder(ring: Path) -> Path:
    """Folder of the readers of a ring; it may exist before the ring."""
    return ring.with_suffix(READERS_SUFFIX)
