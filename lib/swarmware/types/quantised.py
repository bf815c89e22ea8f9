"""Quantised forms as tables, from which codec and documentation are derived."""

import struct
from typing import Final

import msgspec

CODES: Final = {"u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I"}
"""Wire type → code of the struct module; `i24` has none and is coded separately."""


class Part(msgspec.Struct, frozen=True):
    """One number of a quantised form."""

    name: str
    wire: str
    """u8 | i16 | u16 | i24 | i32 | u32, little-endian."""
    meaning: str

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return int(self.wire[1:]) // 8


class Form(msgspec.Struct, frozen=True):
    """One layout of a quantised type: its parts without gaps, then an optional rest."""

    when: str
    """Condition by which a reader recognises this layout."""
    parts: tuple[Part, ...]
    rest: str = ""
    """Content after the parts up to the end of the payload, or "" without such content."""


def packer(parts: tuple[Part, ...]) -> struct.Struct:
    """The codec of these parts, none of which is an i24."""
    return struct.Struct("<" + "".join(CODES[part.wire] for part in parts))
