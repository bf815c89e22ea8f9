"""Conditions against the templates: resources, fields, types and units, with the place in the file."""

import json

import pytest

from swarmware.mission.binding import Binding
from swarmware.mission.check import check_text
from swarmware.mission.finding import Finding, sound
from swarmware.mission.loader import load
from swarmware.mission.vocabulary import Vocabulary
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Resource


def found(condition: str, kinds: tuple[str, ...] = (), kind: str = "uav") -> list[Finding]:
    text = (
        '{"requires": [' + json.dumps(condition) + '],\n "mission": {"s": {"type": "Start", "next": "e"},'
        ' "e": {"type": "End"}}}'
    )
    return check_text(
        text, "m.json", Binding(f"{kind}1", PlatformKind(kind)), kinds=map(PlatformKind, kinds)
    )[1]


@pytest.mark.parametrize(
    "condition",
    [
        "battery < 80 %",
        "altitude > 10",
        "/uav1/nav/pose.z_m > 3",
        "nav/pose.yaw_rad > 1 and not (nav/pose.z_m < power/battery.remaining_ratio)",
        "vehicle/state.armed",
        "vehicle/state.armed == true or vehicle/state.armed != false",
        "health/state.level != 'error'",
        "mission/state.state == 'running'",
        "age(/gcs/nav/pose) < 9 and 30 % < battery",
        "not vehicle/state.armed and power/battery.remaining_ratio >= 0.3",
        'health/state.sensors.gnss == "valid"',
        "'invalid' != vehicle/state.armed",
    ],
)
def test_what_can_be_meant_is_sound(condition: str) -> None:
    assert found(condition) == []


@pytest.mark.parametrize(
    ("condition", "said", "column"),
    [
        ("nav/pose.z > 3", "Pose has no field 'z'; did you mean 'z_m'?", 1),
        ("battery > 3 % and /uav1/nav/pose.hight_m > 3", "Pose has no field 'hight_m'", 19),
        ("nav/pose.z_m.q > 3", "nav/pose.z_m is a number: expected nothing after it, not '.q'", 1),
        ("nav/pose > 3", "'nav/pose' is a Pose: expected one of its fields (x_m, y_m, z_m", 1),
        ("nav/pose.z_m == 'high'", "nav/pose.z_m is a number, 'high' is a text: expected the same", 1),
        ("3 < vehicle/state.armed", "3.0 is a number, vehicle/state.armed is true or false", 5),
        ("nav/pose.z_m", "nav/pose.z_m is a number: expected a comparison", 1),
        ("age(nav/pose)", "age(nav/pose) is a number: expected a comparison", 5),
        ("age(nav/pose) < 'old'", "is a number, 'old' is a text", 5),
        ("vehicle/state.armed > false", "expected == or !=, not >", 1),
        ("health/state.level < 'error'", "expected == or !=, not <", 1),
        ("health/state.level == 'eror'", "is never 'eror': expected one of ", 1),
        ("nav/status.state == 'arived'", "is never 'arived': expected one of 'idle', 'moving', 'arrived'", 1),
        ("battery < 80", "is never 80: expected 0 to 1, or 80 %", 1),
        ("altitude > 50 %", "nav/pose.z_m is not a ratio: expected a number without %", 1),
        ("age(nav/pose) > 5 %", "age(nav/pose) is not a ratio", 5),
        ("age(nav) < 1", "'nav' is a branch", 0),
        ("sys/vehicle/arm.armed", "is a command, which has no value", 1),
        ("health/state.faults == 'x'", "health/state.faults is a list: expected the index of an item", 1),
        ("health/state.sensors", "health/state.sensors is a map: expected one of its keys in brackets", 1),
        ("health/state.sensors.gnss == 'vald'", "is true or false, 'vald' is a text: expected the same", 1),
        ("health/state.sensors.gnss < 'valid'", "is true or false: expected == or !=, not <", 1),
        ("health/state.level == 'valid'", "is never 'valid': expected one of ", 1),
        ("health/state.sensors['sensor/gnss'] > 1", "is true or false, 1.0 is a number", 1),
        (
            "health/state.faults.first == 'x'",
            "is a list: expected an index, such as health/state.faults[0]",
            1,
        ),
        ("health/state.faults['a'] == 'x'", 'health/state.faults["a"] is true or false', 1),
        ("nav/goal.offset_m[3] > 1", "nav/goal.offset_m has 3 items: expected an index below that", 1),
        ("nav/goal.offset_m['a']", "is a list: expected an index, such as nav/goal.offset_m[0]", 1),
        ("nav/goal.course[0] > 1", "nav/goal.course[0] is a list: expected the index", 1),
        ("hal/drivers.drivers[0] == 'x'", "is a DriverStatus: expected one of its fields (name, ", 1),
        ("hal/drivers.drivers[0].state == 'gone'", "is never 'gone': expected one of 'running'", 1),
        ("absent(nav/pose.xm)", "Pose has no field 'xm'; did you mean 'x_m'?", 8),
        ("absent(nav/pose)", "'nav/pose' is a Pose: expected one of its fields", 8),
    ],
)
def test_impossible_term_is_refused_with_place(condition: str, said: str, column: int) -> None:
    findings = found(condition)
    if column == 0:  # no path of a resource at all
        assert findings and "expected a resource path" in findings[0].message
        return
    (finding,) = findings
    assert (finding.severity, finding.rule, finding.pointer) == ("error", "condition", "/requires/0")
    assert said in finding.message
    assert finding.line == 1
    assert finding.column == len('{"requires": ["') + column
    assert str(finding).startswith(f"m.json:1:{finding.column}: /requires/0: condition ")


def test_decision_condition_has_line_and_column() -> None:
    text = """{"mission": {"s": {"type": "Start", "next": "d"},
 "d": {"type": "Decision", "next": "e", "cases": [
  {"if": "nav/pose.z_m > $id", "next": "e"},
  {"if": "nav/pose.x > 1", "next": "e"}]},
 "e": {"type": "End"}}}"""
    (finding,) = check_text(text.replace("$id", "1"), "m.json", Binding())[1]
    assert (finding.line, finding.column, finding.pointer) == (4, 11, "/mission/d/cases/1/if")


def test_unknown_resource_warns_with_nearest() -> None:
    (finding,) = found("nav/poze.z_m > 3")
    assert finding.severity == "warning"
    assert "is in no template; did you mean 'nav/pose'?" in finding.message
    assert sound([finding])
    assert [f.severity for f in found("crop/wetness.ratio > 0.5 and age(crop/wetness) < 3")] == [
        "warning"
    ] * 2


@pytest.mark.parametrize(
    ("kinds", "condition", "severity", "said"),
    [
        (("uav",), "config/navigator/heading_weight > 1", "error", "belongs to a ugv or usv: no uav has it"),
        (("uav", "ugv"), "config/navigator/heading_weight > 1", "warning", "no uav has it"),
        (("ugv",), "3 > /ugv1/sensor/height", "error", "belongs to a uav: no ugv has it"),
        (("ugv",), "age(sensor/height) < 1", "error", "belongs to a uav: no ugv has it"),
        (("gcs",), "battery > 30 %", "error", "no gcs has it"),
        (("ugv", "gcs"), "nav/pose.z > 3", "warning", "no gcs has it"),
    ],
)
def test_resource_of_another_kind_has_line_and_column(
    kinds: tuple[str, ...], condition: str, severity: str, said: str
) -> None:
    finding = found(condition, kinds, kinds[0])[0]
    assert (finding.severity, finding.rule, finding.line) == (severity, "condition", 1)
    assert said in finding.message
    assert finding.column >= len('{"requires": ["') + 1


@pytest.mark.parametrize(
    ("kinds", "condition"),
    [
        (("ugv", "usv"), "config/navigator/heading_weight > 1"),
        (("uav",), "sensor/height > 1"),
        (("uav",), "/ugv1/config/navigator/heading_weight > 1"),
        (("gcs",), "/uav1/power/battery.remaining_ratio > 30 %"),
        (("uav", "ugv", "gcs"), "health/state.level != 'error'"),
    ],
)
def test_resource_of_asked_kind_is_sound(kinds: tuple[str, ...], condition: str) -> None:
    assert found(condition, kinds, kinds[0]) == []


def test_field_is_held_against_resource_of_each_kind() -> None:
    vocabulary = Vocabulary()
    vocabulary.add("uav", [Resource(path="winch/length", type="Float", range=(0.0, 12.0))])
    vocabulary.add("ugv", [Resource(path="winch/length", type="Float", range=(0.0, 50.0))])
    text = json.dumps(
        {
            "requires": ["winch/length > 20"],
            "mission": {"s": {"type": "Start", "next": "e"}, "e": {"type": "End"}},
        }
    )
    mission = load(text, "m.json", Binding())
    assert vocabulary.check(mission, ["ugv"]) == []
    (problem,) = vocabulary.check(mission, ["ugv", "uav"])
    assert "expected 0 to 12" in problem.message


def test_uninstalled_package_type_is_warning() -> None:
    text = '{"requires": ["crop/wetness.depth_m > 3"],'
    text += '"mission": {"s": {"type": "Start", "next": "e"}, "e": {"type": "End"}}}'
    mission = load(text, "m.json", Binding())
    (problem,) = Vocabulary([Resource(path="crop/wetness", type="Wetness")]).check(mission)
    assert problem.severity == "warning"
    assert "type 'Wetness' of 'crop/wetness' is not installed" in problem.message


def test_plain_values_are_held_against_range_and_choices() -> None:
    vocabulary = Vocabulary(
        [
            Resource(path="winch/length", type="Float", range=(0.0, 12.0)),
            Resource(path="winch/mode", type="Text", choices=("in", "out")),
        ]
    )

    def said(condition: str) -> list[str]:
        text = json.dumps(
            {"requires": [condition], "mission": {"s": {"type": "Start", "next": "e"}, "e": {"type": "End"}}}
        )
        return [problem.message for problem in vocabulary.check(load(text, "m.json", Binding()))]

    assert said("winch/length > 3 and winch/mode == 'in'") == []
    assert "winch/length is never 20: expected 0 to 12" in said("winch/length > 20")[0]
    assert "winch/mode is never 'up': expected one of 'in', 'out'" in said("winch/mode == 'up'")[0]
