"""Values of types that a module defines are read without the module: the log has their description."""

import csv
import io
import json
from pathlib import Path

import jsonschema
import msgspec
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from swarmctl.commands.log.export import export
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.payload_type import logged_description, payload_class, schema
from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.segment import LogChannel
from swarmware.recorder.spool import SpoolSource, write
from swarmware.types import registry
from swarmware.types.description import describe

UTC = 1_700_000_000_000_000_000


class Cell(msgspec.Struct, frozen=True, array_like=True):
    """One cell of the grid."""

    east_m: float
    north_m: float


class Plume(msgspec.Struct, frozen=True, array_like=True):
    """Concentration of a gas, in the cells around the platform."""

    ppm: float
    cells: tuple[Cell, ...] = ()
    gas: str = msgspec.field(name="class", default="CH4")


class Alarm(msgspec.Struct, frozen=True):
    """A type whose MessagePack is a map."""

    level: int
    note: str | None = None


def described(cls: type[msgspec.Struct]) -> str:
    return logged_description(msgspec.json.encode(describe(cls)).decode())


def channel(value: msgspec.Struct, path: str, text: str) -> LogChannel:
    return LogChannel("uav1", path, "board", type(value).__name__, "uav1:gas:out", "", text)


VALUES = (
    (
        Plume(3.5, (Cell(1.0, 2.0),), "NO2"),
        {"ppm": 3.5, "cells": [{"east_m": 1, "north_m": 2}], "class": "NO2"},
    ),
    (Alarm(2), {"level": 2, "note": None}),
)


def record(directory: Path) -> Path:
    ring = LogRing(directory)
    for number, (value, _) in enumerate(VALUES):
        entry = channel(value, f"gas/{number}", described(type(value)))
        ring.append(entry, number, UTC + number, registry.encode(value))
    ring.close()
    return directory


def test_entries_keep_field_names_through_spool(tmp_path: Path) -> None:
    entries = list(FolderSource([record(tmp_path)]).entries(Query()))
    assert [entry.plain() for entry in entries] == [plain for _, plain in VALUES]
    file = io.BytesIO()
    write(entries, file)
    file.seek(0)
    assert list(SpoolSource(file, "x").entries(Query())) == entries


def test_segment_has_schema_with_fields_of_type(tmp_path: Path) -> None:
    with segments(record(tmp_path))[0].open("rb") as file:
        found = {
            s.name: (json.loads(s.data), msgspec.msgpack.decode(m.data))
            for s, _, m in make_reader(file).iter_messages()
            if s
        }
    for document, content in found.values():
        jsonschema.Draft202012Validator(document).validate(content)
    fields = found["Plume"][0]["$defs"]["Plume"]["prefixItems"]
    assert [field["title"] for field in fields] == ["ppm", "cells", "class"]
    assert list(found["Alarm"][0]["$defs"]["Alarm"]["properties"]) == ["level", "note"]


def test_exports_have_the_names_of_the_fields(tmp_path: Path) -> None:
    entries = list(FolderSource([record(tmp_path / "log")]).entries(Query()))
    export(iter(entries), "csv", f"{tmp_path}/tables/")
    with (tmp_path / "tables" / "Plume.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["ppm"], row["class"]) == ("3.5", "NO2")
    export(iter(entries), "mcap", f"{tmp_path}/x.mcap")
    with (tmp_path / "x.mcap").open("rb") as file:
        found = {
            s.name: (json.loads(s.data), json.loads(m.data))
            for s, _, m in make_reader(file).iter_messages()
            if s
        }
    document, content = found["Plume"]
    assert content == VALUES[0][1]
    assert document["properties"]["cells"]["items"]["properties"] == {
        "east_m": {"type": "number"},
        "north_m": {"type": "number"},
    }
    jsonschema.Draft202012Validator(document).validate(content)


def test_another_versions_value_is_read_by_description() -> None:
    @registry.register
    class Wake(msgspec.Struct, frozen=True, array_like=True):
        width_m: float
        age_s: float

    text = described(Wake)
    assert payload_class("Wake", text) is Wake
    older = text.replace("width_m", "length_m")
    entry = LogEntry(
        "q", 1, "uav1", "a/b", "board", "Wake", 0, UTC, registry.encode(Wake(2.0, 1.0)), "", 0, older
    )
    assert entry.plain() == {"length_m": 2.0, "age_s": 1.0}


@given(st.one_of(st.text(), st.binary().map(lambda data: data.decode("latin-1"))))
def test_any_text_as_description_leaves_value_without_names(text: str) -> None:
    entry = LogEntry("q", 1, "uav1", "a/b", "board", "Nobody", 0, UTC, b"\x92\x01\x02", "", 0, text)
    assert entry.plain() == [1, 2]
    assert schema("Nobody", text) == b""
