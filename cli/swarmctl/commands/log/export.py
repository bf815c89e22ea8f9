"""Entries as files that other tools read: JSON Lines, CSV, MCAP with JSON, a stream of MessagePack."""

import csv
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import msgspec

from swarmctl.terminal.quantities import utc_text
from swarmware.recorder.entry import LogEntry


def export(entries: Iterator[LogEntry], form: str, target: str) -> int:
    """Writes the entries; how many there were."""
    writers: dict[str, Callable[[Iterator[LogEntry], str], int]] = {
        "jsonl": _jsonl,
        "csv": _csv,
        "mcap": _mcap,
        "msgpack": _msgpack,
    }
    return writers[form](entries, target)


@contextmanager
def _text(target: str) -> Iterator[TextIO]:
    if target == "-":
        yield sys.stdout
        return
    with Path(target).open("w", encoding="utf-8", newline="") as file:
        yield file


@contextmanager
def _binary(target: str) -> Iterator[BinaryIO]:
    if target == "-":
        yield sys.stdout.buffer
        return
    with Path(target).open("wb") as file:
        yield file


def _jsonl(entries: Iterator[LogEntry], target: str) -> int:
    count = 0
    with _text(target) as file:
        for entry in entries:
            line = {
                "utc": utc_text(entry.utc_ns),
                "utc_ns": entry.utc_ns,
                "stamp_ns": entry.stamp_ns,
                "path": entry.topic,
                "type": entry.type,
                **({"sender": entry.sender} if entry.sender else {}),
                "value": entry.plain(),
            }
            file.write(msgspec.json.encode(line).decode() + "\n")
            count += 1
    return count


def _csv(entries: Iterator[LogEntry], target: str) -> int:
    """One row per entry; the columns are the fields of all types that occur, nested ones with dots."""
    rows = []
    columns: dict[str, None] = {}
    for entry in entries:
        fields = dict(_flat("", entry.plain()))
        columns |= dict.fromkeys(fields)
        rows.append((entry, fields))
    with _text(target) as file:
        writer = csv.writer(file)
        writer.writerow(["utc", "utc_ns", "stamp_ns", "path", "type", *columns])
        for entry, fields in rows:
            head = [utc_text(entry.utc_ns), entry.utc_ns, entry.stamp_ns, entry.topic, entry.type]
            writer.writerow([*head, *(fields.get(column, "") for column in columns)])
    return len(rows)


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{prefix}.{key}" if prefix else key, item)
    elif isinstance(value, list):
        yield prefix or "value", msgspec.json.encode(value).decode()
    else:
        yield prefix or "value", value


def _msgpack(entries: Iterator[LogEntry], target: str) -> int:
    """One value after the other, for pipes; `log query --spool` reads it again."""
    from swarmware.recorder.spool import write

    with _binary(target) as file:
        return write(entries, file)


def _mcap(entries: Iterator[LogEntry], target: str) -> int:
    """JSON messages with a schema, so that viewers plot them as they are."""
    from mcap.writer import Writer

    schemas: dict[str, int] = {}
    channels: dict[tuple[str, str], int] = {}
    count = 0
    with _binary(target) as file:
        writer: Any = Writer(file)
        writer.start(profile="", library="swarmctl")
        for entry in entries:
            if entry.type not in schemas:
                # viewers only need to know that fields are named; the values carry their own types
                schemas[entry.type] = writer.register_schema(entry.type, "jsonschema", b'{"type":"object"}')
            key = (entry.topic, entry.type)
            if key not in channels:
                channels[key] = writer.register_channel(entry.topic, "json", schemas[entry.type])
            value = entry.plain()
            data = msgspec.json.encode(value if isinstance(value, dict) else {"value": value})
            writer.add_message(channels[key], entry.utc_ns, data, entry.utc_ns, entry.sequence)
            count += 1
        writer.finish()
    return count
