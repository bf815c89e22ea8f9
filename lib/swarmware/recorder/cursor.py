"""The position of a consumer in a log ring."""

import msgspec


class Cursor(msgspec.Struct, frozen=True):
    """Position in a platform's ring up to which entries are stored: forwarding resumes here."""

    segment: int = 0
    """Number of the segment."""
    offset: int = 0
    """Offset in the segment behind the last stored entry, in bytes."""
    sequences: dict[str, int] = {}
    """Last stored sequence number, by queue."""
