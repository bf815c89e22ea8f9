"""mission.toml: each error with its line, key and the expected value; the schema says what the code does."""

import json
import tomllib
from typing import Any

import jsonschema
import pytest
import tomli_w
from file_schemas import manifest_schema
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import ConfigError
from swarmware.mission.budget import QUICK_BYTES, Budget
from swarmware.mission.check import check_files, check_folder
from swarmware.mission.finding import Finding, sound
from swarmware.mission.folder import from_files, read_folder
from swarmware.mission.manifest import read_manifest
from swarmware.model.config import share_dir
from swarmware.types.mission import MissionFile

SHIPPED = share_dir() / "schemas" / "manifest.schema.json"
MISSIONS = sorted((share_dir() / "missions").glob("*/mission.toml"))

TEXT = """\
name = "survey"
title = "Two roles"

[params]
leader = "$role.head"
speed_m_s = 2.0

[[roles]]
name = "head"
file = "head.json"
kinds = ["ugv"]
take = 1

[[roles]]
name = "air"
file = "air.json"
kinds = ["uav"]
params = {height_m = {first = 5.0, step = 1.5}}
"""
HEAD = """{"params": {"speed_m_s": 1.0}, "mission": {
 "s": {"type": "Start", "next": "g"},
 "g": {"type": "Goto", "x": 1, "y": 2, "speed": "$param.speed_m_s", "next": "e"},
 "e": {"type": "End"}}}"""
AIR = """{"params": {"height_m": 3.0, "leader": "ugv1"}, "mission": {
 "s": {"type": "Start", "next": "a"}, "a": {"type": "Arm", "next": "t"},
 "t": {"type": "Takeoff", "alt": "$param.height_m", "next": "f"},
 "f": {"type": "Formation", "leader": "$param.leader", "next": "l"},
 "l": {"type": "Land", "next": "e"},
 "e": {"type": "End"}}}"""


def findings(text: str) -> list[Finding]:
    files = [MissionFile("mission.toml", text), MissionFile("head.json", HEAD), MissionFile("air.json", AIR)]
    return check_folder(from_files(files, "survey"))


def test_the_mission_of_these_tests_is_sound() -> None:
    assert findings(TEXT) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("title =", "titel =", "line 2: key titel: unknown; did you mean title?"),
        ("take = 1", "tak = 1", "line 12: key roles[0].tak: unknown; did you mean take?"),
        ("take = 1", "take = -1", "line 12: key roles[0].take: expected `int` >= 0 (it is -1)"),
        ("take = 1", "take = 'x'", "line 12: key roles[0].take: expected `int`, got `str` (it is 'x')"),
        ("take = 1", "take =", "line 12: invalid TOML: Invalid value (at line 12, column 7)"),
        ("speed_m_s = 2.0", "speed_m_s = nan", "line 6: key params.speed_m_s: nan; expected a finite number"),
        (
            'file = "air.json"\n',
            "",
            "line 14: key roles[1].file: missing; expected the name of a file in the mission's folder, "
            "such as air.json",
        ),
        (
            '"air.json"',
            '"../air.json"',
            "line 16: key roles[1].file: expected the name of a file in the mission's folder, such as "
            "air.json (it is '../air.json')",
        ),
        (
            '"air.json"',
            '"sea.json"',
            "line 16: key roles[1].file: 'sea.json' is missing; expected it beside mission.toml",
        ),
        ('"air"', '"head"', "line 15: key roles[1].name: 'head' is a role already; expected unique names"),
        (
            '["uav"]',
            '["uav", "plane"]',
            "line 17: key roles[1].kinds[1]: unknown kind 'plane'; expected one of uav, ugv, usv, gcs",
        ),
        ('["uav"]', "[]", "line 17: key roles[1].kinds: expected `array` of length >= 1 (it is [])"),
        ("step =", "stp =", "line 18: key roles[1].params.height_m.stp: unknown; did you mean step?"),
        (
            "speed_m_s = 2.0",
            "speed_m_s = {a = 1}",
            "line 6: key params.speed_m_s: expected `bool | int | float | str | array`, got `object`",
        ),
    ],
)
def test_error_names_file_line_key_and_expectation(old: str, new: str, message: str) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(ConfigError) as caught:
        findings(TEXT.replace(old, new))
    assert str(caught.value) == f"survey/mission.toml: {message}"


def test_a_manifest_without_roles_is_refused() -> None:
    with pytest.raises(ConfigError, match="key roles: missing; expected an array"):
        read_manifest("name = 'a'", "m")
    with pytest.raises(ConfigError, match="line 2: key roles: expected `array` of length >= 1"):
        read_manifest("name = 'a'\nroles = []", "m")
    with pytest.raises(ConfigError, match="key name: missing; expected a text"):
        read_manifest("", "m")


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        (
            "$role.head",
            "$role.haed",
            5,
            "key params.leader: '$role.haed': no such role; did you mean $role.head?",
        ),
        (
            "height_m =",
            "hight_m =",
            18,
            "key roles[1].params.hight_m: no role declares it; did you mean height_m?",
        ),
        (
            "speed_m_s = 2.0",
            'speed_m_s = "fast"',
            6,
            "key params.speed_m_s: parameter 'speed_m_s' was given 'fast': expected a number, as its default "
            "(used at survey/head.json:1 /params/speed_m_s)",
        ),
        (
            "speed_m_s = 2.0",
            "speed_m_s = 99.0",
            6,
            "key params.speed_m_s: parameter 'speed' of Goto: expected `float` <= 30.0, it is 99.0 "
            "(used at survey/head.json:3 /mission/g/speed)",
        ),
        (
            "first = 5.0",
            "first = -5.0",
            18,
            "key roles[1].params.height_m: parameter 'alt' of Takeoff: expected `float` > 0.0, it is -5.0 "
            "(used at survey/air.json:3 /mission/t/alt)",
        ),
    ],
)
def test_value_unusable_by_roles_names_its_line(old: str, new: str, line: int, message: str) -> None:
    (finding,) = findings(TEXT.replace(old, new))
    assert (finding.file, finding.line, finding.severity) == ("survey/mission.toml", line, "error")
    assert finding.message == message


def test_parameter_of_optional_role_is_warning() -> None:
    (finding,) = findings(TEXT.replace("take = 1", "take = 1\nrequired = false"))
    assert (finding.line, finding.severity, finding.rule) == (5, "warning", "role-optional")


def test_finding_of_invalid_manifest_has_its_line(tmp_path: Any) -> None:
    (tmp_path / "mission.toml").write_text(TEXT.replace("take = 1", "take = -1"))
    (finding,) = check_files([tmp_path])
    assert (finding.file, finding.line) == (f"{tmp_path}/mission.toml", 12)
    assert finding.message.startswith("key roles[0].take: ")


# -- the schema


VALIDATOR = jsonschema.Draft202012Validator(json.loads(manifest_schema()))


def test_the_shipped_schema_is_that_of_the_code() -> None:
    assert SHIPPED.read_text() == manifest_schema(), "make docs"
    jsonschema.Draft202012Validator.check_schema(json.loads(SHIPPED.read_text()))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
def test_the_manifests_of_the_shipped_missions_are_valid(path: Any) -> None:
    VALIDATOR.validate(tomllib.loads(path.read_text()))
    assert sound(check_files([path.parent]))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
def test_shipped_mission_is_checked_in_process(path: Any) -> None:
    assert sound(check_folder(read_folder(path.parent), budget=Budget(QUICK_BYTES)))


SCALAR = st.sampled_from([0, -1, 1.5, "a", "", "x" * 70, True, "a.json", "../a", "uav"])
ROLE = st.fixed_dictionaries(
    {},
    optional={
        "name": st.sampled_from(["air", "ground"]) | SCALAR,
        "file": st.just("air.json") | SCALAR,
        "kinds": st.lists(st.sampled_from(["uav", "ugv", "plane"]), max_size=2) | SCALAR,
        "take": st.integers(-2, 2_000) | SCALAR,
        "required": st.booleans() | SCALAR,
        "params": st.dictionaries(
            st.sampled_from(["a", "b"]),
            SCALAR
            | st.fixed_dictionaries({"first": SCALAR, "step": SCALAR})
            | st.just({"first": 1})
            | st.just([[1.0, 2.0]]),
            max_size=2,
        )
        | SCALAR,
        "other": SCALAR,
    },
)
GOOD = {"name": "air", "file": "air.json", "kinds": ["uav"]}


@given(
    st.fixed_dictionaries(
        {"name": st.just("a") | SCALAR, "roles": st.lists(ROLE | st.just(GOOD), max_size=2) | SCALAR},
        optional={
            "title": SCALAR,
            "params": st.dictionaries(st.sampled_from(["a"]), SCALAR | st.just([[1.0]]) | st.just({}))
            | SCALAR,
            "more": SCALAR,
        },
    )
)
def test_schema_and_code_agree_about_every_manifest(raw: dict[str, Any]) -> None:
    try:
        read_manifest(tomli_w.dumps(raw), "m")
        problem = ""
    except ConfigError as error:
        problem = error.message
    if "is a role already" in problem:
        return  # no schema expresses that
    assert bool(problem) == (not VALIDATOR.is_valid(raw)), problem
