"""Files of other tools are recognised by their begin, and named where a user hands them over."""

import gzip
import json
import sqlite3
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.commands.mission.task import check_all, task
from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.model.foreign_format import foreign_format

ROOT = Path(__file__).parents[2]
TERRAIN = (ROOT / "tests/data/terrain.waypoints").read_bytes()
PLAN = {
    "fileType": "Plan",
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "groundStation": "QGroundControl",
    "mission": {"items": [], "version": 2},
    "version": 1,
}
KML = b'<?xml version="1.0" encoding="UTF-8"?>\n<!-- a path -->\n<kml xmlns="http://www.opengis.net/kml/2.2">'
CASES = [
    (TERRAIN, "QGC WPL), frame 0 (above mean sea level), 10 (above the terrain)"),
    (b"QGC WPL 110\n", "QGC WPL"),
    (b"QGC WPL 110\n0 1 99 16 0 0 0 0 47 8 10 1\nx\n\xff \xff \xff \xff", "frame 99 (unknown here)"),
    (json.dumps(PLAN).encode(), "plan of QGroundControl"),
    (json.dumps(dict(reversed(PLAN.items())), indent=4).encode(), "plan of QGroundControl"),
    (KML, "KML"),
    (b'<gpx version="1.1">', "GPX"),
    (b"ULog\x01\x12\x35\x01" + bytes(8), "ULog"),
    (b"\xa3\x95\x80\x80\x59FMT", "DataFlash"),
    (b"#ROSBAG V2.0\n", "rosbag"),
    (b"rosbag2_bagfile_information:\n  version: 5\n", "rosbag2"),
    (b"\x89MCAP0\r\n\x01", "MCAP"),
    (b"PK\x03\x04\x14", "KMZ"),
    (gzip.compress(b"a", mtime=0), "gzip"),
    (b"\x28\xb5\x2f\xfd\x04", "Zstandard"),
    (b"PAR1\x15", "Parquet"),
]


@pytest.mark.parametrize(("head", "name"), CASES)
def test_a_file_of_another_tool_is_named(head: bytes, name: str) -> None:
    assert name in foreign_format(head)
    for start in (b"", b"\xef\xbb\xbf"):
        with pytest.raises(ConfigError, match=r"^here: .*: not readable here; expected") as refused:
            document.text(start + head, "here")
        assert name in str(refused.value)
        assert refused.value.exit_code == 7


def test_a_database_is_named(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "a.db3") as database:
        database.execute("create table messages (id integer)")
    database.close()
    assert "rosbag2" in foreign_format((tmp_path / "a.db3").read_bytes())


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b'# instead of <kml> or QGC WPL\nplatform = "uav1"\n',
        b'{"package": "a", "note": "fileType Plan"}',
        b'text = "PK"',
    ],
)
def test_own_files_are_not_taken_for_others(content: bytes) -> None:
    assert foreign_format(content) == ""


def test_no_shipped_file_is_taken_for_another() -> None:
    shipped = [path for folder in ("etc", "share/swarm") for path in (ROOT / folder).rglob("*.*")]
    texts = [path for path in shipped if path.suffix in {".toml", ".json", ".csv"}]
    assert len(texts) > 50
    assert [path for path in texts if foreign_format(path.read_bytes())] == []


@given(st.binary(max_size=200))
def test_any_bytes_are_recognised_or_not(head: bytes) -> None:
    assert isinstance(foreign_format(head), str)


@pytest.mark.parametrize("name", ["survey.waypoints", "survey.plan", "survey.json"])
def test_a_plan_of_another_tool_is_no_mission(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(TERRAIN if name.endswith("waypoints") else json.dumps(PLAN).encode())
    (verdict,) = check_all([str(path)])
    assert not verdict.sound
    assert "QGroundControl" in verdict.findings[0].message
    assert str(verdict.findings[0]).count(str(path)) == 1
    with pytest.raises(ConfigError, match=rf"{name}: .*QGroundControl"):
        task(str(path), (), ())


def test_plan_in_mission_folder_is_named(tmp_path: Path) -> None:
    shipped = ROOT / "share/swarm/missions/formation"
    for path in shipped.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    role = next(path for path in tmp_path.iterdir() if path.suffix == ".json")
    role.write_text(json.dumps(PLAN))
    (verdict,) = check_all([str(tmp_path)])
    assert {finding.file for finding in verdict.findings} == {str(role)}


def test_mission_with_byte_order_mark_is_same_mission(tmp_path: Path) -> None:
    shipped = ROOT / "share/swarm/missions/formation"
    for path in shipped.iterdir():
        if path.suffix in {".toml", ".json"}:
            (tmp_path / path.name).write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert task(str(tmp_path), (), ()).files == task(str(shipped), (), ()).files
    (verdict,) = check_all([str(tmp_path)])
    assert verdict.sound
