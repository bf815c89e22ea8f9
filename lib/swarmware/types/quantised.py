"""Quantised forms as tables: what codes them and what documents them follow from the same rows."""

import struct
from typing import Final

import msgspec

CODES: Final = {"u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I"}
"""Wire type → code of the struct module; `i24` has none and is coded by hand."""


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
    """One layout of a quantised type: its parts without gaps, then perhaps more."""

    when: str
    """What tells a reader that it is this one."""
    parts: tuple[Part, ...]
    rest: str = ""
    """What follows the parts to the end of the payload; empty: nothing."""


def packer(parts: tuple[Part, ...]) -> struct.Struct:
    """What packs these parts, of which none is an i24."""
    return struct.Struct("<" + "".join(CODES[part.wire] for part in parts))
