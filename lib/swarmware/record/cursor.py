"""How far a ring has been stored elsewhere."""

import msgspec


class Cursor(msgspec.Struct, frozen=True):
    """How far a platform's ring has been stored: where its logger goes on."""

    segment: int = 0
    """Number of the segment."""
    offset: int = 0
    """Byte behind the last entry stored."""
    sequences: dict[str, int] = {}
    """Last sequence stored, by queue."""
