"""Entries as files that other tools read: JSON Lines, CSV, Parquet, MCAP, a stream of MessagePack."""

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import msgspec

from swarmctl.terminal.quantities import utc_text
from swarmctl.viewers.lost_values import LostValues
from swarmware.errors import InvalidInput, NotFound
from swarmware.geometry.geodesy import Origin
from swarmware.model.visible import json_escaped
from swarmware.recorder.entry import LogEntry
from swarmware.runtime.filewriter import naming
from swarmware.types.json_form import exported_form


def export(
    entries: Iterator[LogEntry],
    form: str,
    target: str,
    origins: Mapping[str, Origin] | None = None,
    lost: LostValues | None = None,
) -> int:
    """Writes the entries; their number. `origins`: of the maps of the platforms, those that are known.

    `lost` counts values that the format cannot hold.

    Raises: NotFound when there are none, before a file is written; InvalidInput for an unsuitable target.
    """
    # read before the file is opened, so that an empty result does not overwrite an earlier export
    first = next(entries, None)
    if first is None:
        raise NotFound("no entry matches: nothing is written; expected entries of that path, type and time")
    found = chain((first,), entries)
    lost = LostValues() if lost is None else lost
    if form in ("csv", "parquet"):
        # writes files by itself, as a folder may get several
        from swarmctl.commands.log.tables import write_tables

        return write_tables(found, form, target, lost)
    with _binary(target) as file:
        match form:
            case "mcap":
                from swarmctl.viewers.mcap_export import write_mcap

                return write_mcap(found, file, origins or {}, lost)
            case "msgpack":
                # `log query --spool` reads it again
                from swarmware.recorder.spool import write

                return write(found, file)
        return _write_lines(found, file, lost)


@contextmanager
def _binary(target: str) -> Iterator[BinaryIO]:
    if target == "-":
        yield sys.stdout.buffer
        return
    if Path(target).is_dir():
        raise InvalidInput(f"--out {target}: a folder; expected the name of a file")
    with naming(target), Path(target).open("wb") as file:
        yield file


def _write_lines(entries: Iterable[LogEntry], file: BinaryIO, lost: LostValues) -> int:
    """One JSON object a line; 64-bit integers are text, as in `log query --json`, and bytes are base64."""
    count = 0
    for entry in entries:
        try:
            value = exported_form(entry.content())
        except RecursionError:
            lost.add(f"{entry.type or 'value'}, nested too deep")
            value = None
        line = {
            "utc": utc_text(entry.utc_ns),
            "utc_ns": str(entry.utc_ns),
            "stamp_ns": str(entry.stamp_ns),
            "path": entry.topic,
            "type": entry.type,
            **({"sender": entry.sender} if entry.sender else {}),
            "value": value,
        }
        file.write(json_escaped(msgspec.json.encode(line).decode()).encode() + b"\n")
        count += 1
    return count
