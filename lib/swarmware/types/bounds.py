"""Ranges of received numbers and names of files: a decoder accepts only values that are safe to use.

MessagePack carries integers of 65 bits, infinities and NaN; a field of one of these types does not.
"""

import re
from typing import Annotated, Final

from msgspec import Meta

_NAME: Final = r"[A-Za-z0-9_][A-Za-z0-9._+-]{0,99}"
_END: Final = r"(?!\n)$"
"""End of a pattern, in Python and in JSON Schema: `$` of Python also matches before a last line break."""
_WHOLE: Final = re.compile(rf"{_NAME}\Z")

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
FileName = Annotated[str, Meta(pattern=rf"^{_NAME}{_END}")]
"""Name of a file in a folder that the receiver knows: no folders, not hidden."""
MemberFileName = Annotated[str, Meta(pattern=rf"^{_NAME}(/mission\.json)?{_END}")]
"""A file name, or `<id>/mission.json`: the file in the folder of a mission's member."""
OptionalFileName = Annotated[str, Meta(pattern=rf"^({_NAME})?{_END}")]
"""A file name, or an empty text where none is meant."""


def is_file_name(text: str) -> bool:
    """Whether the text names a file in a folder, and leads to no other folder."""
    return _WHOLE.match(text) is not None
