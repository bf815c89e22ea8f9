"""Ranges of received numbers: a decoder accepts only values that are safe in headers, arithmetic and clocks.

MessagePack carries integers of 65 bits, infinities and NaN; a field of one of these types does not.
"""

from typing import Annotated

from msgspec import Meta

Uint16 = Annotated[int, Meta(ge=0, le=0xFFFF)]
Uint32 = Annotated[int, Meta(ge=0, le=0xFFFF_FFFF)]
Count = Annotated[int, Meta(ge=0, le=2**63 - 1)]
"""A non-negative integer: sequences, serials, sizes."""
Instant = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
"""Nanoseconds of some clock, as the header of a frame holds them; also differences of two."""
Finite = Annotated[float, Meta(ge=-1e12, le=1e12)]
"""A quantity to calculate with, in any unit used here."""
Seconds = Annotated[float, Meta(ge=0, le=1e9)]
"""A duration: thirty years of nanoseconds fit an integer of 64 bits."""
Hertz = Annotated[float, Meta(ge=0, le=1e6)]
Ratio = Annotated[float, Meta(ge=-1, le=1)]
PathText = Annotated[str, Meta(max_length=400)]
"""A path or a pattern of paths."""
