"""Exports are opened again by what they were made for."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from swarmctl.commands.log.export import export
from swarmware.recorder.entry import LogEntry
from swarmware.types import registry
from swarmware.types.scalar import Float
from swarmware.types.vehicle import BatteryState


def entries() -> Iterator[LogEntry]:
    values: list[tuple[str, msgspec.Struct]] = [
        ("power/battery", BatteryState(11.1, 2.0, 0.5)),
        ("config/gain", Float(2.5)),
        ("power/battery", BatteryState(11.0, 2.0, 0.49)),
    ]
    for number, (path, value) in enumerate(values, 1):
        payload = registry.encode(value)
        kind = type(value).__name__
        yield LogEntry(
            "uav1:hal:out", number, "uav1", path, "board", kind, 5 * number, 10**18 + number, payload
        )


def test_json_lines_are_a_document_each(tmp_path: Path) -> None:
    target = tmp_path / "x.jsonl"
    assert export(entries(), "jsonl", str(target)) == 3
    lines = [json.loads(line) for line in target.read_text().splitlines()]
    assert [line["path"] for line in lines] == [
        "/uav1/power/battery",
        "/uav1/config/gain",
        "/uav1/power/battery",
    ]
    assert lines[0]["value"] == {"voltage_v": 11.1, "current_a": 2.0, "remaining_ratio": 0.5}
    assert (lines[2]["stamp_ns"], lines[2]["utc_ns"]) == (15, 10**18 + 3)


def test_a_table_has_the_columns_of_all_types(tmp_path: Path) -> None:
    target = tmp_path / "x.csv"
    assert export(entries(), "csv", str(target)) == 3
    with target.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:5] == ["utc", "utc_ns", "stamp_ns", "path", "type"]
    assert [row["voltage_v"] for row in rows] == ["11.1", "", "11.0"]
    assert [row["value"] for row in rows] == ["", "2.5", ""]


def test_a_recording_is_read_by_the_public_library(tmp_path: Path) -> None:
    target = tmp_path / "x.mcap"
    assert export(entries(), "mcap", str(target)) == 3
    with target.open("rb") as file:
        reader = make_reader(file)
        found = [(c.topic, json.loads(m.data), m.log_time) for _, c, m in reader.iter_messages()]
        summary = reader.get_summary()
    assert found[1] == ("/uav1/config/gain", {"value": 2.5}, 10**18 + 2)
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 3


@pytest.mark.parametrize("form", ["jsonl", "csv", "mcap"])
def test_an_export_of_nothing_is_a_whole_file(form: str, tmp_path: Path) -> None:
    target = tmp_path / f"x.{form}"
    assert export(iter(()), form, str(target)) == 0
    assert target.exists()
    if form == "mcap":
        with target.open("rb") as file:
            assert list(make_reader(file).iter_messages()) == []
