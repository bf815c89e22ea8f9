"""Tables of an export: safe files, columns by the fields of a type, every value kept, little memory."""

import csv
import enum
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import msgspec
import pytest

from swarmctl.commands.log.columns import ColumnKind, columns_of
from swarmctl.commands.log.export import export
from swarmctl.commands.log.tables import TABLES_LIMIT, safe_name, write_tables
from swarmctl.viewers.lost_values import LostValues
from swarmware.errors import InvalidInput, NotFound, Partial
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.payload_type import logged_description
from swarmware.types import registry
from swarmware.types.description import describe
from swarmware.types.vehicle import BatteryState, Pose

UTC = 1_700_000_000_000_000_000


class Mode(enum.StrEnum):
    """An enumeration of texts."""

    ECO = "eco"
    FULL = "full"


class Gear(enum.IntEnum):
    """An enumeration of numbers."""

    LOW = 1
    HIGH = 2


class Place(msgspec.Struct, frozen=True):
    """A nested type."""

    x_m: float
    name: str = ""


@registry.register
class Survey(msgspec.Struct, frozen=True):
    """A type with a field of each kind."""

    valid: bool
    count: int
    digest: int
    level: float
    mode: Mode
    gear: Gear
    side: Literal["left", "right"]
    data: bytes
    place: Place
    speeds_m_s: tuple[float, ...] = ()
    stops: list[Place] = []
    raw: list[bytes] = []
    params: dict[str, int] = {}
    any: Any = None
    maybe: float | None = None
    last: Place | None = None
    number: int | float = 0
    mixed: int | str = 0
    path: str = ""


SURVEY = Survey(
    True,
    -3,
    2**64 - 1,
    0.5,
    Mode.FULL,
    Gear.HIGH,
    "left",
    b"\x00\xff",
    Place(1.5, "a"),
    (1.0, 2.0),
    [Place(2.0)],
    [b"\x01"],
    {"k": 1},
    {"b": b"\x02"},
    path="inner",
)
EMPTY = Survey(False, 0, 0, 0.0, Mode.ECO, Gear.LOW, "right", b"", Place(0.0))

ARROW = {
    "utc": "timestamp[ns, tz=UTC]",
    "utc_ns": "int64",
    "stamp_ns": "int64",
    "path": "string",
    "sender": "string",
    "valid": "bool",
    "count": "int64",
    "digest": "uint64",
    "level": "double",
    "mode": "string",
    "gear": "int64",
    "side": "string",
    "data": "binary",
    "place.x_m": "double",
    "place.name": "string",
    "speeds_m_s": "list<element: double>",
    "stops": "list<element: struct<x_m: double, name: string>>",
    "raw": "list<element: binary>",
    "params": "string",
    "any": "string",
    "maybe": "double",
    "last.x_m": "double",
    "last.name": "string",
    "number": "double",
    "mixed": "string",
    "value.path": "string",
}


def entry(type_name: str, payload: bytes, number: int = 1, **changes: Any) -> LogEntry:
    found = LogEntry("uav1:x:out", number, "uav1", "x/y", "event", type_name, number, UTC + number, payload)
    return msgspec.structs.replace(found, **changes)


def unknown(*values: Any, type_name: str = "Unheard") -> Iterator[LogEntry]:
    for number, value in enumerate(values, start=1):
        yield entry(type_name, msgspec.msgpack.encode(value), number)


def survey(value: Survey, number: int = 1) -> LogEntry:
    return entry("Survey", registry.encode(value), number)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def parquet_table(path: Path) -> Any:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `parquet` is not installed")
    return parquet.read_table(path)


def columns(path: Path) -> dict[str, list[Any]]:
    # a datetime of Python has no nanoseconds
    found: dict[str, list[Any]] = parquet_table(path).drop_columns(["utc"]).to_pydict()
    return found


@pytest.mark.parametrize(
    "name, expected",
    [
        ("Pose", "Pose"),
        ("pkg/Pose", "pkg_Pose"),
        ("foxglove.Pose", "foxglove.Pose"),
        ("../../escaped", "escaped"),
        ("/etc/cron.d/x", "etc_cron.d_x"),
        ("a\x00b", "a_b"),
        ("x\n\x1b[31m\u202e", "x_31m"),
        ("..", "unknown"),
        ("", "unknown"),
        ("Größe", "Gr_e"),
        ("\\\\server\\share", "server_share"),
        (".hidden", "hidden"),
        ("-rf", "rf"),
        ("CON", "_CON"),
        ("nul.x", "_nul.x"),
        ("Console", "Console"),
        ("a" * 300, "a" * 100),
        ("a." * 300, "a_" * 49 + "a_"),
    ],
)
def test_type_name_becomes_file_name_in_folder(name: str, expected: str) -> None:
    assert safe_name(name) == expected or (name.startswith("a.") and len(safe_name(name)) <= 100)


HOSTILE = [
    "../../escaped",
    "/tmp/absolute",
    "pkg/Pose",
    "pkg_Pose",
    "PKG_POSE",
    "n\x00l",
    "x" * 300,
    "..",
    "CON",
    "",
]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_types_from_log_stay_inside_folder(form: str, tmp_path: Path) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    target = tmp_path / "a" / "b"
    entries = [one for name in HOSTILE for one in unknown({"name": name}, type_name=name)]
    assert export(iter(entries), form, f"{target}/") == len(HOSTILE)
    inside = sorted(path.name for path in target.iterdir())
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == [
        target / name for name in inside
    ]
    assert len({name.casefold() for name in inside}) == len(HOSTILE)
    assert all(name.endswith(f".{form}") for name in inside)
    if form == "csv":
        found = {path.stem: rows(path)[0]["name"] for path in target.iterdir()}
        assert sorted(found.values()) == sorted(HOSTILE)
        assert (found["PKG_POSE"], found["pkg_Pose_2"], found["pkg_Pose_3"]) == (
            "PKG_POSE",
            "pkg_Pose",
            "pkg/Pose",
        )


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_refused_export_leaves_former_file_and_nothing_else(form: str, tmp_path: Path) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    target = tmp_path / f"x.{form}"
    target.write_text("former")
    entries = [entry("Pose", registry.encode(Pose(1.0, 2.0)), 1), survey(SURVEY, 2), *unknown(1)]
    with pytest.raises(InvalidInput, match=r"3 tables of a type each \(Pose, Survey, Unheard\)"):
        export(iter(entries), form, str(target))
    with pytest.raises(NotFound, match="no folder"):
        export(iter(entries), form, str(tmp_path / "none" / "x"))
    assert target.read_text() == "former"
    assert list(tmp_path.iterdir()) == [target]
    with pytest.raises(InvalidInput, match=f"more than {TABLES_LIMIT} types"):
        export(
            (one for n in range(TABLES_LIMIT + 1) for one in unknown(1, type_name=f"T{n}")),
            form,
            f"{tmp_path}/",
        )
    assert list(tmp_path.iterdir()) == [target]


def test_parquet_columns_follow_fields_not_values(tmp_path: Path) -> None:
    for name, values in (("a", [SURVEY]), ("b", [EMPTY]), ("c", [EMPTY, SURVEY])):
        entries = [survey(one, number) for number, one in enumerate(values)]
        export(iter(entries), "parquet", f"{tmp_path}/{name}.parquet")
    tables = [parquet_table(tmp_path / f"{name}.parquet") for name in "abc"]
    assert {field.name: str(field.type) for field in tables[0].schema} == ARROW
    assert tables[0].schema == tables[1].schema == tables[2].schema
    found = columns(tmp_path / "c.parquet")
    assert found["digest"] == [0, 2**64 - 1] and found["count"] == [0, -3]
    assert found["data"] == [b"", b"\x00\xff"] and found["raw"] == [[], [b"\x01"]]
    assert found["mode"] == ["eco", "full"] and found["gear"] == [1, 2]
    assert found["maybe"] == [None, None] and found["last.x_m"] == [None, None]
    assert found["stops"] == [[], [{"x_m": 2.0, "name": ""}]] and found["speeds_m_s"] == [[], [1.0, 2.0]]
    assert found["params"] == ["{}", '{"k":1}'] and found["any"] == [None, '{"b":"Ag=="}']
    assert found["path"] == ["/uav1/x/y"] * 2 and found["value.path"] == ["", "inner"]


def test_uninstalled_module_type_has_same_columns() -> None:
    from swarmware.recorder.payload_type import payload_class

    text = logged_description(msgspec.json.encode(describe(Survey)).decode())
    described = payload_class("Elsewhere", text)
    here = [(one.name, one.content.kind) for one in columns_of(Survey)]
    there = [(one.name, one.content.kind) for one in columns_of(described)]
    assert there == here


def test_two_versions_of_a_type_are_two_tables(tmp_path: Path) -> None:
    class Version(msgspec.Struct, frozen=True):
        """First version."""

        a: int

    first = logged_description(msgspec.json.encode(describe(Version)).decode())
    second = logged_description(
        msgspec.json.encode(describe(msgspec.defstruct("Version", [("a", int), ("b", str)]))).decode()
    )
    found = [
        entry("Version", b"\x81\xa1a\x01", 1, description=first),
        entry("Version", b"\x82\xa1a\x02\xa1b\xa1x", 2, description=second),
        entry("Version", b"\x01", 3, description=second),
    ]
    export(iter(found), "csv", f"{tmp_path}/")
    tables = [rows(tmp_path / name) for name in ("Version.csv", "Version_2.csv", "Version_3.csv")]
    assert [list(table[0])[5:] for table in tables] == [["a"], ["a", "b"], ["value"]]


def test_csv_has_base64_bytes_and_json_lists(tmp_path: Path) -> None:
    export(iter([survey(SURVEY), survey(EMPTY, 2)]), "csv", f"{tmp_path}/x.csv")
    first, second = rows(tmp_path / "x.csv")
    assert (first["data"], first["raw"], first["any"]) == ("AP8=", '["AQ=="]', '{"b":"Ag=="}')
    assert (first["mode"], first["gear"], first["valid"]) == ("full", "2", "True")
    assert (first["speeds_m_s"], second["maybe"], second["last.x_m"]) == ("[1.0,2.0]", "", "")
    assert first["digest"] == str(2**64 - 1)


COLLIDING = [
    ({"a.b": 1, "a": {"b": 2}}, {"a.b": 1, "a.b_2": 2}),
    ({"": 1, "value": 2}, {"value": 1, "value_2": 2}),
    ({"utc": 1, "value.utc": 2}, {"value.utc": 1, "value.utc_2": 2}),
    ({1: "x", "1": "y"}, {"1": "x", "1_2": "y"}),
    ({"a": {}, "b": []}, {"a": "{}", "b": "[]"}),
    ([1, b"\x02"], {"value": '[1,"Ag=="]'}),
    (7, {"value": 7}),
    (b"\x00\xff", {"value": b"\x00\xff"}),
    ({"n": 2**63}, {"n": 2**63}),
]


@pytest.mark.parametrize("value, expected", COLLIDING)
def test_value_of_unknown_type_keeps_all_its_parts(
    value: Any, expected: dict[str, Any], tmp_path: Path
) -> None:
    export(unknown(value), "csv", f"{tmp_path}/x.csv")
    (row,) = rows(tmp_path / "x.csv")
    texts = {key: "AP8=" if one == b"\x00\xff" else str(one) for key, one in expected.items()}
    assert dict(list(row.items())[5:]) == texts
    export(unknown(value), "parquet", f"{tmp_path}/x.parquet")
    found = {key: one[0] for key, one in columns(tmp_path / "x.parquet").items()}
    assert dict(list(found.items())[4:]) == expected
    export(unknown(value), "jsonl", f"{tmp_path}/x.jsonl")
    line = json.loads((tmp_path / "x.jsonl").read_text())["value"]
    if isinstance(value, dict):
        assert len(line) == len(value)


@pytest.mark.parametrize(
    "values, kind, expected",
    [
        ([1, 2.5], "double", [1.0, 2.5]),
        ([1, None], "int64", [1, None]),
        ([True, 1], "string", ["true", "1"]),
        ([2**60, 0.5], "string", [str(2**60), "0.5"]),
        ([2**64 - 1, 0], "uint64", [2**64 - 1, 0]),
        ([2**64 - 1, -1], "string", [str(2**64 - 1), "-1"]),
        (["a", 1], "string", ["a", "1"]),
        ([None, None], "string", [None, None]),
    ],
)
def test_column_of_unknown_type_holds_every_value(
    values: list[Any], kind: str, expected: list[Any], tmp_path: Path
) -> None:
    export(unknown(*({"a": value} for value in values)), "parquet", f"{tmp_path}/x.parquet")
    table = parquet_table(tmp_path / "x.parquet")
    assert (str(table.schema.field("a").type), table.column("a").to_pylist()) == (kind, expected)


def test_map_with_many_keys_is_one_cell(tmp_path: Path) -> None:
    export(unknown({str(n): n for n in range(3000)}, {"a": 1}), "csv", f"{tmp_path}/x.csv")
    first, second = rows(tmp_path / "x.csv")
    assert len(json.loads(first["value"])) == 3000 and json.loads(second["value"]) == {"a": 1}


STAMPS = [-1, 0, 2**63 - 1, 2**63, 2**64 - 1]


def stamped() -> Iterator[LogEntry]:
    for number, stamp in enumerate(STAMPS):
        yield entry("Pose", registry.encode(Pose(1.0, 2.0)), number, utc_ns=stamp, stamp_ns=stamp)


def test_odd_stamps_are_text_null_and_counted(tmp_path: Path) -> None:
    export(stamped(), "csv", f"{tmp_path}/x.csv")
    assert [int(row["utc_ns"]) for row in rows(tmp_path / "x.csv")] == STAMPS
    export(stamped(), "jsonl", f"{tmp_path}/x.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "x.jsonl").read_text().splitlines()]
    assert [int(line["stamp_ns"]) for line in lines] == STAMPS
    assert lines[0]["utc"] == "1969-12-31T23:59:59.999Z"
    lost = LostValues()
    export(stamped(), "parquet", f"{tmp_path}/x.parquet", lost=lost)
    found = columns(tmp_path / "x.parquet")
    assert found["utc_ns"] == found["stamp_ns"] == [-1, 0, 2**63 - 1, None, None]
    with pytest.raises(
        Partial, match=r"Pose, column stamp_ns, beyond 64 bits with sign: 2; Pose, column utc"
    ):
        lost.refuse()


def test_odd_stamps_become_the_nearest_time_of_mcap(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    export(stamped(), "mcap", f"{tmp_path}/x.mcap")
    with (tmp_path / "x.mcap").open("rb") as file:
        found = [
            message.log_time
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic == "/uav1/x/y"
        ]
    assert sorted(found) == [0, 0, 2**63 - 1, 2**63, 2**64 - 1]


def test_number_beyond_its_column_is_null_and_counted(tmp_path: Path) -> None:
    lost = LostValues()
    odd = msgspec.structs.replace(SURVEY, count=2**63, digest=-1)
    export(iter([survey(odd), survey(SURVEY, 2)]), "parquet", f"{tmp_path}/x.parquet", lost=lost)
    found = columns(tmp_path / "x.parquet")
    assert (found["count"], found["digest"]) == ([None, -3], [None, 2**64 - 1])
    with pytest.raises(Partial, match=r"column count, beyond 64 bits with sign: 1; Survey, column digest"):
        lost.refuse()


@pytest.mark.parametrize("form", ["jsonl", "csv", "parquet", "mcap", "msgpack"])
@pytest.mark.parametrize("levels", [200, 900])
def test_value_nested_too_deep_is_counted_and_omitted(form: str, levels: int, tmp_path: Path) -> None:
    lost = LostValues()
    entries = [entry("Deep", b"\x81\xa1n" * levels + b"\x01"), *unknown({"n": 1}, type_name="Deep")]
    assert export(iter(entries), form, f"{tmp_path}/x", lost=lost) == 2
    if levels == 200 or form == "msgpack":
        lost.refuse()
    else:
        with pytest.raises(Partial, match="Deep, nested too deep: 1"):
            lost.refuse()
    if form == "csv":
        assert len(rows(tmp_path / "x")) == 2


def test_mistyped_values_are_table_of_their_own(tmp_path: Path) -> None:
    good = entry("BatteryState", registry.encode(BatteryState(12.0, 1.0, 0.5)), 1)
    bad = entry("BatteryState", msgspec.msgpack.encode(["much"]), 2)
    export(iter([good, bad]), "csv", f"{tmp_path}/")
    assert [row["voltage_v"] for row in rows(tmp_path / "BatteryState.csv")] == ["12.0"]
    assert [row["value"] for row in rows(tmp_path / "BatteryState_2.csv")] == ['["much"]']


def test_a_table_on_stdout_is_whole_or_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert write_tables([survey(SURVEY), survey(EMPTY, 2)], "csv", "-") == 2
    assert len(list(csv.DictReader(capsys.readouterr().out.splitlines()))) == 2
    with pytest.raises(InvalidInput, match="2 tables"):
        write_tables([survey(SURVEY), *unknown(1)], "csv", "-")
    assert capsys.readouterr().out == ""


PEAK = """
import re, sys
from pathlib import Path
from swarmctl.commands.log.export import export
from swarmware.recorder.entry import LogEntry
from swarmware.types import registry
from swarmware.types.vehicle import Pose
payload = registry.encode(Pose(1.0, 2.0))
entries = (
    LogEntry("q", n, "uav1", "nav/pose", "board", sys.argv[3], n, n, payload) for n in range(int(sys.argv[4]))
)
export(entries, sys.argv[1], sys.argv[2])
print(int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""
"""Exports entries and prints the peak of its memory in MB (`ru_maxrss` would include the parent)."""


@pytest.mark.parametrize("type_name", ["Pose", "Unheard"])
@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_memory_of_export_is_constant_over_rows(form: str, type_name: str, tmp_path: Path) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    target = str(tmp_path / "x")

    def peak_mb(count: int) -> int:
        command = [sys.executable, "-c", PEAK, form, target, type_name, str(count)]
        return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    few, many = peak_mb(20_000), peak_mb(60_000)
    assert many < 300 and many - few < 12, f"{few} MB, then {many} MB: the rows are kept"


def test_kinds_of_columns_are_those_of_the_fields() -> None:
    kinds = {one.name: one.content.kind for one in columns_of(Survey)}
    assert (kinds["data"], kinds["raw"], kinds["params"]) == (
        ColumnKind.BYTES,
        ColumnKind.LIST,
        ColumnKind.JSON,
    )
