"""Exports are opened again by what they were made for."""

import base64
import csv
import json
import math
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
from mcap.reader import make_reader
from tests.unit.cli.flight import UTC, entry, flight

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log.export import export
from swarmctl.commands.log.origins import origins
from swarmctl.terminal.output import Output
from swarmctl.viewers.viewer_form import viewer_schema
from swarmware.errors import InvalidInput, NotFound
from swarmware.geometry.geodesy import Origin
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load, share_dir
from swarmware.recorder.entry import LogEntry
from swarmware.testing.tmpnode import make_node
from swarmware.types import registry
from swarmware.types.scalar import Blob, Float
from swarmware.types.vehicle import BatteryState, Pose

LOCATION = "foxglove.LocationFix"


@registry.register
class Sighting(msgspec.Struct, frozen=True):
    """A type of a module's own, whose names on the wire come from another program."""

    count: int
    species: str = msgspec.field(name="class")


def entries() -> Iterator[LogEntry]:
    yield entry("power/battery", BatteryState(11.1, 2.0, 0.5), 1)
    yield entry("config/gain", Float(2.5), 2)
    yield entry("power/battery", BatteryState(11.0, 2.0, 0.49), 3)


def messages(path: Path) -> list[tuple[str, str, dict[str, Any], Any]]:
    """Topic, name of the schema, content and message of each record; each content satisfies its schema."""
    found = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = json.loads(message.data)
            jsonschema.Draft202012Validator(json.loads(schema.data)).validate(content)
            found.append((channel.topic, schema.name, content, message))
    return found


def test_json_lines_hold_wide_integers_as_text(tmp_path: Path) -> None:
    target = tmp_path / "x.jsonl"
    assert export(entries(), "jsonl", str(target)) == 3
    lines = [json.loads(line) for line in target.read_text().splitlines()]
    assert [line["path"] for line in lines] == [
        "/uav1/power/battery",
        "/uav1/config/gain",
        "/uav1/power/battery",
    ]
    assert lines[0]["value"] == {"voltage_v": 11.1, "current_a": 2.0, "remaining_ratio": 0.5}
    assert (lines[2]["stamp_ns"], lines[2]["utc_ns"]) == ("15", str(UTC + 3))


def test_table_has_columns_of_its_type_alone(tmp_path: Path) -> None:
    target = tmp_path / "tables/"
    target.mkdir()
    assert export(entries(), "csv", str(target)) == 3
    assert sorted(path.name for path in target.iterdir()) == ["BatteryState.csv", "Float.csv"]
    with (target / "BatteryState.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    columns = ["utc", "utc_ns", "stamp_ns", "path", "sender", "voltage_v", "current_a", "remaining_ratio"]
    assert list(rows[0]) == columns
    assert [row["voltage_v"] for row in rows] == ["11.1", "11.0"]


def test_one_type_is_file_several_need_folder(tmp_path: Path) -> None:
    target = tmp_path / "x.csv"
    battery = [one for one in entries() if one.type == "BatteryState"]
    assert export(iter(battery), "csv", str(target)) == 2
    assert len(target.read_text().splitlines()) == 3
    target.unlink()
    for place in (str(target), "-"):
        with pytest.raises(InvalidInput, match=r"BatteryState, Float\); expected --type"):
            export(entries(), "csv", place)
    assert not target.exists()


def test_no_column_of_table_has_name_of_another(tmp_path: Path) -> None:
    from swarmware.types.log import GapCause, LogGap

    target = tmp_path / "gaps.csv"
    export(iter([entry("log/gaps", LogGap(GapCause.RING, "q", "a/b", 3), 1, "event")]), "csv", str(target))
    with target.open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["path"], row["value.path"]) == ("/uav1/log/gaps", "a/b")


@registry.register
class Tally(msgspec.Struct, frozen=True):
    """Integers beyond what a double keeps."""

    photons: int
    late_ns: int
    digest: int
    valid: bool = True


def test_plotted_integers_are_numbers_and_identities_text(tmp_path: Path) -> None:
    wide = 2**60 + 1
    export(iter([entry("a/tally", Tally(wide, -wide, wide), 1)]), "mcap", f"{tmp_path}/x.mcap")
    ((_, _, content, _),) = messages(tmp_path / "x.mcap")
    assert content == {"photons": wide, "late_ns": -wide, "digest": str(wide), "valid": True}
    kinds = {key: one["type"] for key, one in viewer_schema("Tally")["properties"].items()}
    assert kinds == {"photons": "integer", "late_ns": "integer", "digest": "string", "valid": "boolean"}


def test_renamed_field_keeps_schema_name_in_exports(tmp_path: Path) -> None:
    seen = [entry("camera/sighting", Sighting(2, "heron"), 1)]
    for form in ("csv", "jsonl", "mcap"):
        export(iter(seen), form, f"{tmp_path}/x.{form}")
    with (tmp_path / "x.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["count"], row["class"], "species" in row) == ("2", "heron", False)
    assert json.loads((tmp_path / "x.jsonl").read_text())["value"] == {"count": 2, "class": "heron"}
    ((_, _, content, _),) = messages(tmp_path / "x.mcap")
    assert content == {"count": 2, "class": "heron"} and seen[0].plain() == content
    assert list(viewer_schema("Sighting")["properties"]) == ["count", "class"]


def test_a_parquet_table_has_typed_columns(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `parquet` is not installed")
    assert export(flight(), "parquet", f"{tmp_path}/tables/") == 9
    table = parquet.read_table(tmp_path / "tables" / "Pose.parquet")
    assert table.num_rows == 2
    assert str(table.schema.field("utc").type) == "timestamp[ns, tz=UTC]"
    assert table.column("z_m").to_pylist() == [3.0, 3.1]
    assert table.column("stamp_ns").to_pylist() == [5, 10]


def test_recording_has_fields_and_both_times_utc(tmp_path: Path) -> None:
    target = tmp_path / "x.mcap"
    assert export(entries(), "mcap", str(target)) == 3
    found = messages(target)
    assert [(topic, content) for topic, _, content, _ in found][1] == ("/uav1/config/gain", {"value": 2.5})
    assert [(m.log_time, m.publish_time) for *_, m in found] == [(UTC + n, UTC + n - 1000) for n in (1, 2, 3)]
    with target.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == 3
    schemas = {schema.name: json.loads(schema.data) for schema in summary.schemas.values()}
    assert schemas["BatteryState"]["properties"] == {
        "voltage_v": {"type": "number"},
        "current_a": {"type": "number"},
        "remaining_ratio": {"type": "number"},
    }


def test_bytes_are_base64_in_recording_and_schema(tmp_path: Path) -> None:
    export(iter([entry("sensor/raw", Blob(b"\x00\xff"), 1)]), "mcap", f"{tmp_path}/x.mcap")
    ((_, _, content, _),) = messages(tmp_path / "x.mcap")
    assert base64.b64decode(content["value"]) == b"\x00\xff"
    encoded = viewer_schema("Blob")["properties"]["value"]
    assert encoded == {"type": "string", "contentEncoding": "base64"}
    export(iter([entry("sensor/raw", Blob(b"\x00\xff"), 1)]), "jsonl", f"{tmp_path}/x.jsonl")
    assert json.loads((tmp_path / "x.jsonl").read_text())["value"] == {"value": "AP8="}


WRITE = """
from swarmctl.commands.log.export import export
from tests.unit.cli.flight import flight
export(flight(), "mcap", "-")
"""


def test_recording_is_written_to_pipe_and_file(tmp_path: Path) -> None:
    export(flight(), "mcap", f"{tmp_path}/x.mcap")
    expected = (tmp_path / "x.mcap").read_bytes()
    piped = subprocess.run([sys.executable, "-c", WRITE], check=True, capture_output=True)
    assert piped.stdout == expected
    with (tmp_path / "redirected.mcap").open("wb") as file:
        done = subprocess.run([sys.executable, "-c", WRITE], check=True, stdout=file, stderr=subprocess.PIPE)
    assert done.stderr == b"" and (tmp_path / "redirected.mcap").read_bytes() == expected
    assert len(messages(tmp_path / "redirected.mcap")) == len(messages(tmp_path / "x.mcap")) > 9


def test_foxglove_panels_get_poses_points_images_and_logs(tmp_path: Path) -> None:
    target = tmp_path / "x.mcap"
    assert export(flight(), "mcap", str(target)) == 9
    shown = {topic: (name, content) for topic, name, content, _ in messages(target) if "foxglove" in topic}
    assert {topic: name for topic, (name, _) in shown.items()} == {
        "/foxglove/uav1/nav/pose": "foxglove.PoseInFrame",
        "/foxglove/tf": "foxglove.FrameTransform",
        "/foxglove/uav1/sim/truth": "foxglove.PoseInFrame",
        "/foxglove/uav1/sensor/gnss": "foxglove.LocationFix",
        "/foxglove/uav1/sensor/range": "foxglove.PointCloud",
        "/foxglove/uav1/sensor/lidar": "foxglove.PointCloud",
        "/foxglove/uav1/sensor/camera": "foxglove.CompressedImage",
        "/foxglove/log": "foxglove.Log",
    }
    pose = shown["/foxglove/uav1/nav/pose"][1]
    assert (pose["frame_id"], pose["pose"]["position"]) == ("map", {"x": 1.0, "y": 2.0, "z": 3.0})
    assert pose["timestamp"] == {"sec": 1_699_999_999, "nsec": 999_999_001}
    moved = shown["/foxglove/tf"][1]
    assert (moved["parent_frame_id"], moved["child_frame_id"]) == ("map", "uav1")
    fix = shown["/foxglove/uav1/sensor/gnss"][1]
    assert (fix["latitude"], fix["altitude"], fix["position_covariance"][4]) == (48.1, 0.0, 0.25)
    points = struct.unpack("<9f", base64.b64decode(shown["/foxglove/uav1/sensor/range"][1]["data"]))
    assert points == pytest.approx((1, 0, 0, 0, 2, 0, 0, -4, 0), abs=1e-6)
    cloud = base64.b64decode(shown["/foxglove/uav1/sensor/lidar"][1]["data"])
    assert len(cloud) == 12 * 384
    assert {round(math.hypot(*struct.unpack_from("<3f", cloud, at)), 4) for at in range(0, 4608, 12)} == {10}
    image = shown["/foxglove/uav1/sensor/camera"][1]
    assert (image["format"], base64.b64decode(image["data"])) == ("jpeg", b"\xff\xd8\xff\xe0 picture")
    line = shown["/foxglove/log"][1]
    assert (line["level"], line["message"]) == (4, "battery low (confirmed): Battery: 11.0 V")


def test_poses_are_on_map_with_known_origin(tmp_path: Path) -> None:
    origin = Origin(lat_deg=48.0, lon_deg=11.0, alt_ellipsoid_m=500.0)
    poses = [
        entry("nav/pose", Pose(74.4, 111.2, 20.0), 1),
        entry("nav/pose", Pose(1e12, -1e12, 0.0), 2),
        entry("sim/truth", Pose(1.0, 2.0, 3.0), 3),
    ]
    for known, expected in (({"uav1": origin}, 1), ({"uav2": origin}, 0), (None, 0)):
        export(iter(poses), "mcap", f"{tmp_path}/x.mcap", known)
        found = [content for _, name, content, _ in messages(tmp_path / "x.mcap") if name == LOCATION]
        assert len(found) == expected, known
    export(iter(poses), "mcap", f"{tmp_path}/x.mcap", {"uav1": origin})
    ((topic, _, fix, message),) = [one for one in messages(tmp_path / "x.mcap") if one[1] == LOCATION]
    assert topic == "/foxglove/uav1/nav/pose/location"
    assert (fix["latitude"], fix["longitude"]) == pytest.approx((48.001, 11.001), abs=1e-5)
    assert fix["altitude"] == pytest.approx(520.0, abs=0.01)
    assert (fix["position_covariance_type"], fix["frame_id"]) == (0, "uav1")
    assert (message.log_time, message.publish_time) == (UTC + 1, UTC - 999)


def test_origin_comes_from_world_of_node_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_node(tmp_path, services={"navigator": {"world": "field"}})
    out = Output(CliSettings(config=str(folder)))
    expected = load(paths.world(share_dir(), "field"), World).origin
    assert origins({}, out) == {"uav1": expected} and expected != Origin()
    for source in ("folder", "mongodb", "spool"):
        assert origins({source: "x"}, out) == {}, "it does not state its origin"
    other = make_node(tmp_path, platform="uav2", services={"navigator": {"world": "nowhere"}})
    assert origins({}, Output(CliSettings(config=str(other)))) == {}
    assert "no position of uav2 on the map panel" in capsys.readouterr().err


def test_schema_of_registered_type_has_no_references() -> None:
    def check(node: dict[str, Any], where: str) -> None:
        assert isinstance(node["type"], str), where
        assert not {"$ref", "anyOf", "prefixItems"} & node.keys(), where
        if node["type"] == "array":
            assert node["items"]["type"] != "array", where
            check(node["items"], where)
        for key, one in node.get("properties", {}).items():
            check(one, f"{where}.{key}")

    assert not registry.installed("")  # a search for it loads all modules with types
    names = sorted(registry._TYPES)
    assert len(names) > 80
    for name in names:
        found = viewer_schema(name)
        assert found["type"] == "object", name
        check(found, name)
    assert "course" not in viewer_schema("Goal")["properties"], "viewers have no arrays of arrays"


@pytest.mark.parametrize("form", ["jsonl", "csv", "parquet", "mcap", "msgpack"])
def test_empty_export_is_refused_and_writes_nothing(form: str, tmp_path: Path) -> None:
    target = tmp_path / f"x.{form}"
    with pytest.raises(NotFound, match="no entry matches"):
        export(iter(()), form, str(target))
    assert not target.exists()
