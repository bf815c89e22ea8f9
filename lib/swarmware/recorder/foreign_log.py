"""Recognises logs of other programs, so that a refusal names them and none counts as damaged."""

import io
from pathlib import Path
from typing import BinaryIO, Final

from swarmware.errors import InvalidInput
from swarmware.model.foreign_format import HEAD_BYTES, foreign_format
from swarmware.recorder.scan import CHANNEL, HEADER, LENGTHS, MAGIC, RECORD

_CHUNK: Final = 0x06
_RECORDS: Final = 64
"""Records before the first channel or chunk that are read; own segments have fewer than ten."""
_ENCODINGS: Final = frozenset({b"cdr", b"ros1", b"json", b"protobuf", b"flatbuffer", b"cbor"})
"""Encodings of messages that no logger here writes; damage does not make one of them of another.

Source: MCAP format registry, well-known message encodings.
"""
_SEGMENTS: Final = "a folder with the .mcap segments of a logger"
_OWN: Final = "swarmware"
"""Begin of the library in the header of own files."""


def foreign_log(path: Path) -> str:
    """Format of a file that no logger of Swarmware wrote.

    Empty for a segment of a logger, whole or damaged, and for a file that cannot be read.
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
            if not head.startswith(MAGIC):
                return foreign_format(head)
            file.seek(len(MAGIC))
            return _foreign_mcap(file)
    except OSError:  # the reader of its entries names the reason
        return ""


def _foreign_mcap(file: BinaryIO) -> str:
    library = ""
    for _ in range(_RECORDS):
        head = file.read(RECORD.size)
        if len(head) < RECORD.size:
            return ""
        opcode, length = RECORD.unpack(head)
        if opcode == _CHUNK:
            return f"an MCAP file with compressed chunks, of {library or 'another program'}"
        if opcode not in LENGTHS or length > LENGTHS[opcode][1]:
            return ""  # damaged
        if opcode not in {HEADER, CHANNEL}:
            file.seek(length, io.SEEK_CUR)
            continue
        body = file.read(length)
        _first, at = _text(body, 0 if opcode == HEADER else 4)
        second, _ = _text(body, at)
        if opcode == HEADER:
            library = second.decode("utf-8", "replace")[:80]
        elif second in _ENCODINGS:
            if library.startswith(_OWN):
                return "an MCAP file for viewers, of `swarmctl log export --format mcap`"
            kind = second.decode("utf-8", "replace")[:20]
            return f"an MCAP file with channels of another program ({library or 'unnamed'}, {kind})"
        else:
            return ""
    return ""


def _text(body: bytes, at: int) -> tuple[bytes, int]:
    end = at + 4 + int.from_bytes(body[at : at + 4], "little")
    return body[at + 4 : end], end


def refuse_foreign(place: Path) -> None:
    """Raises: InvalidInput for a file of another program, or a folder in which one is."""
    for path in sorted(place.iterdir()) if place.is_dir() else (place,):
        if path.is_file() and (what := foreign_log(path)):
            raise InvalidInput(f"{path}: {what}: not readable here; expected {_SEGMENTS}")
