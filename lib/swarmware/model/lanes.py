"""Arithmetic on bytes as vectors of small integers: differences of neighbours, their sums, zigzag.

One Python integer holds the whole vector, each element in a lane of 8 or 16 bits (SIMD within a register):
the interpreter works on it at the speed of C, and a node needs no numerical library for it.
"""

from functools import lru_cache

BYTE = 1
WORD = 2
"""Bytes of a lane; words are little-endian."""


def differences(data: bytes | bytearray, lane_bytes: int) -> bytes:
    """Each element minus the one before it, modulo its lane; the first one stays."""
    high, low, every = _masks(len(data), lane_bytes)
    now = int.from_bytes(data, "little")
    before = now << 8 * lane_bytes & every
    # the set high bit keeps the borrow inside its lane
    return _bytes(((now | high) - (before & low)) ^ ((now ^ before ^ high) & high), len(data))


def sums(data: bytes | bytearray, lane_bytes: int) -> bytes:
    """Inverse of `differences`: each element plus all before it, modulo its lane."""
    high, low, every = _masks(len(data), lane_bytes)
    total, shift = int.from_bytes(data, "little"), 8 * lane_bytes
    while shift < 8 * len(data):
        # after each turn an element is the sum of twice as many
        added = total << shift & every
        total = ((total & low) + (added & low)) ^ ((total ^ added) & high)
        shift *= 2
    return _bytes(total, len(data))


def zigzag(data: bytes | bytearray, lane_bytes: int) -> bytes:
    """Signed elements as unsigned ones, small for small magnitudes: 0, -1, 1, -2 become 0, 1, 2, 3."""
    bits = 8 * lane_bytes
    high, low, _ = _masks(len(data), lane_bytes)
    vector = int.from_bytes(data, "little")
    negative = (vector & high) >> bits - 1
    return _bytes((vector & low) << 1 ^ negative * ((1 << bits) - 1), len(data))


def unzigzag(data: bytes | bytearray, lane_bytes: int) -> bytes:
    """Inverse of `zigzag`: unsigned elements as signed ones."""
    bits = 8 * lane_bytes
    high, low, _ = _masks(len(data), lane_bytes)
    vector = int.from_bytes(data, "little")
    odd = vector & high >> bits - 1
    return _bytes(vector >> 1 & low ^ odd * ((1 << bits) - 1), len(data))


def _bytes(vector: int, length: int) -> bytes:
    return vector.to_bytes(length, "little")


@lru_cache(maxsize=16)
def _masks(length: int, lane_bytes: int) -> tuple[int, int, int]:
    """The high bit of each lane, the other bits of each lane, all bits."""
    high = int.from_bytes((bytes(lane_bytes - 1) + b"\x80") * (length // lane_bytes), "little")
    every = (1 << 8 * length) - 1
    return high, every ^ high, every
