"""Loading a mission: the published files, every mistake with its place, parameters."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.simulation.seeds import examples
from tests.unit.mission.results import result

from swarmd.mission.checking import refuse
from swarmware.errors import MissionError
from swarmware.mission import catalogue
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import Formation, Goto, Takeoff, Wait
from swarmware.mission.check import check_files, check_text
from swarmware.mission.finding import Finding, sound
from swarmware.mission.loader import load, read
from swarmware.mission.resource_params import ModuleService, Request, WaitForResource
from swarmware.model.platform_kind import PlatformKind

PUBLISHED = Path(__file__).parents[2] / "data" / "bdl"
HERE = Binding("uav3", PlatformKind.UAV, "air", "survey")


def mission(blocks: dict[str, Any], **top: Any) -> str:
    return json.dumps({"mission": blocks, **top}, indent=1)


def line(*middle: dict[str, Any], **top: Any) -> str:
    """Start, the blocks one after the other (b1, b2 …), End."""
    blocks: dict[str, Any] = {"b0": {"type": "Start", "next": "b1"}}
    for number, block in enumerate(middle, 1):
        after = {} if block["type"] == "DecisionRandom" else {"next": f"b{number + 1}"}
        blocks[f"b{number}"] = {**after, **block}
    blocks[f"b{len(middle) + 1}"] = {"type": "End"}
    return mission(blocks, **top)


def findings(text: str) -> list[Finding]:
    return list(read(text, "m.json", HERE).findings)


def only(text: str) -> Finding:
    (finding,) = findings(text)
    return finding


@pytest.mark.parametrize("name", ["decision_test_mission", "join_test_mission"])
def test_published_missions_of_basic_blocks_are_sound(name: str) -> None:
    assert check_files([PUBLISHED / f"{name}.json"]) == []


def test_published_ros_mission_warns_of_lost_keys() -> None:
    found = check_files([PUBLISHED / "mission1.json"])
    assert {finding.severity for finding in found} == {"warning"}
    lost = [(finding.line, finding.pointer) for finding in found if finding.rule == "no-counterpart"]
    assert lost == [
        (19, "/mission/b3/package"),
        (22, "/mission/b3/commandline_args"),
        (27, "/mission/b4/package"),
        (34, "/mission/b5/package"),
    ]


def test_published_blocks_become_those_of_the_table() -> None:
    blocks = load((PUBLISHED / "mission1.json").read_text(), "mission1.json", HERE).blocks
    assert blocks["b2"].params == WaitForResource(path="sensors/temperature/*")
    assert blocks["b3"].params == ModuleService(service="coppternode1")
    # a node without a name has the name of its program
    assert blocks["b4"].params == ModuleService(service="swarm_communication")
    assert blocks["b8"].params == Request(path="copternode1/arm")
    assert blocks["b12"].params == Request(path="copternode1/fly_to", args=(0, 0, 100, 0), answer_s=300)
    ros2 = {"type": "CallServiceROS2", "address": "/a/b", "svctype": "x", "data": '{"on": true}'}
    assert load(line(ros2), "m.json", HERE).blocks["b1"].params == Request(path="a/b", args={"on": True})


def test_published_blocks_without_counterpart_are_named() -> None:
    finding = only(line({"type": "LaunchROS", "package": "p", "launchfile": "l"}))
    assert (finding.rule, finding.pointer) == ("unknown-block", "/mission/b1/type")
    assert "no counterpart: expected a StartModule for each service" in finding.message
    finding = only(line({"type": "CallService", "servicename": ""}))
    assert finding.pointer == "/mission/b1/servicename"
    finding = only(line({"type": "CallService", "servicename": "a/b", "arg": ""}))
    assert finding.pointer == "/mission/b1/arg"


def test_numbers_may_be_texts_in_missions() -> None:
    text = (PUBLISHED / "join_test_mission.json").read_text()
    params = load(text, "join.json", HERE).blocks["b2"].params
    assert isinstance(params, Wait)
    assert params.duration_s == 5.0


def test_short_spellings_mean_the_names_with_units() -> None:
    text = line({"type": "Takeoff", "alt": 5}, {"type": "Goto", "x": 1, "y": "2.5", "z": 3, "speed": 2})
    blocks = load(text, "m.json", HERE).blocks
    assert blocks["b1"].params == Takeoff(altitude_m=5)
    assert blocks["b2"].params == Goto(x_m=1, y_m=2.5, z_m=3, speed_m_s=2)


@pytest.mark.parametrize(
    "edges",
    [
        {"nextTimeout": "b2"},
        {"next_timeout": "b2"},
        {"on": {"timeout": "b2"}},
    ],
)
def test_a_timeout_successor_has_three_spellings(edges: dict[str, Any]) -> None:
    text = line({"type": "Barrier", "id": "x", "timeout": "3000", **edges})
    block = load(text, "m.json", HERE).blocks["b1"]
    assert block.successor(result("timeout")) == "b2"
    assert block.timeout_s == 3.0


@pytest.mark.parametrize("timeout", [{"timeout": "30000"}, {"timeout": 30_000}, {"timeout_s": 30}])
def test_time_out_is_milliseconds_or_has_unit(timeout: dict[str, Any]) -> None:
    text = line({"type": "Arm", **timeout})
    assert load(text, "m.json", HERE).blocks["b1"].timeout_s == 30.0


def test_error_takes_own_then_general_successor() -> None:
    text = line(
        {"type": "Goto", "x": 1, "y": 1, "on": {"blocked": "b2"}, "nextError": "b3"},
        {"type": "Hold"},
        {"type": "Land"},
    )
    block = load(text, "m.json", HERE).blocks["b1"]
    assert block.successor(result("ok")) == "b2"
    assert block.successor(result("error:blocked")) == "b2"
    assert block.successor(result("error:disarmed")) == "b3"
    assert block.successor(result("timeout")) is None


DECISION = {"type": "Decision", "cases": [{"if": "battery < 30 %", "next": "b2"}]}
CHANCE = {"type": "DecisionRandom", "chanceForTrue": 0.5, "nextIfTrue": "b2", "nextIfFalse": "b2"}


@pytest.mark.parametrize(
    ("block", "pointer", "words"),
    [
        ({"type": "Wiat", "s": 1}, "/mission/b1/type", "'Wiat': unknown; nearest known: Wait"),
        ({"type": "Wait"}, "/mission/b1", "exactly one of `ms` and `s`"),
        ({"type": "Wait", "ms": 1, "s": 1}, "/mission/b1", "exactly one of `ms` and `s`"),
        ({"type": "Wait", "ms": "soon"}, "/mission/b1/ms", "expected `float"),
        ({"type": "Wait", "s": "nan"}, "/mission/b1/s", "expected `float"),
        ({"type": "Wait", "s": True}, "/mission/b1/s", "expected `float"),
        ({"type": "Wait", "s": -1}, "/mission/b1/s", ">= 0"),
        ({"type": "Wait", "s": 1, "timeout": 3}, "/mission/b1/timeout", "cannot time out"),
        ({"type": "Wait", "s": 1, "nextTimeout": "b2"}, "/mission/b1/nextTimeout", "cannot time out"),
        ({"type": "Wait", "sec": 1}, "/mission/b1/sec", "nearest known: s"),
        ({"type": "Takeoff"}, "/mission/b1", "parameter 'altitude_m' of Takeoff: missing; expected a number"),
        ({"type": "Takeoff", "alt": -3}, "/mission/b1/alt", "> 0"),
        (
            {"type": "Formation", "leader": "a", "shape": "wege"},
            "/mission/b1/shape",
            "invalid enum value 'wege'; expected one of wedge, line, column",
        ),
        ({"type": "Takeoff", "alt": 3, "altitude": 3}, "/mission/b1/altitude", "same as 'alt'"),
        ({"type": "Takeoff", "alt": 3, "timeout_s": 0}, "/mission/b1/timeout_s", "above 0"),
        ({"type": "Takeoff", "alt": 3, "timeout_s": "x"}, "/mission/b1/timeout_s", "expected seconds"),
        ({"type": "Takeoff", "alt": 3, "timeout_s": 90_000}, "/mission/b1/timeout_s", "at most 86400"),
        ({"type": "Takeoff", "alt": 3, "timeout": 60}, "/mission/b1/timeout", "or `timeout_s` in seconds"),
        ({"type": "Takeoff", "alt": 3, "timeout": True}, "/mission/b1/timeout", "expected milliseconds"),
        ({"type": "Takeoff", "alt": 3, "timeout": "x"}, "/mission/b1/timeout", "expected milliseconds"),
        (
            {"type": "Takeoff", "alt": 3, "timeout": 3000, "timeout_s": 3},
            "/mission/b1/timeout_s",
            "'timeout' is a second time-out",
        ),
        ({"type": "Fork", "next": ["b2"], "nextTimeout": "b2"}, "/mission/b1/nextTimeout", "cannot time out"),
        ({"type": "Fork", "next": ["b2"], "nextError": "b2"}, "/mission/b1/nextError", "cannot fail"),
        ({"type": "Fork", "next": ["b2"], "on": {"timeout": "b2"}}, "/mission/b1/on", "no `on`"),
        ({"type": "Join", "on": {"error": "b2"}}, "/mission/b1/on", "no `on`"),
        ({"type": "Wait", "s": 1, "nextError": "b2"}, "/mission/b1/nextError", "cannot fail"),
        ({**DECISION, "nextTimeout": "b2"}, "/mission/b1/nextTimeout", "cannot time out"),
        ({**DECISION, "on": {"timeout": "b2"}}, "/mission/b1/on/timeout", "cannot time out"),
        ({**DECISION, "on": {"blocked": "b2"}}, "/mission/b1/on/blocked", "expected error, unknown_value"),
        ({**CHANCE, "nextError": "b2"}, "/mission/b1/nextError", "cannot fail"),
        ({**CHANCE, "next": "b2"}, "/mission/b1/next", "instead of `next`"),
        ({**CHANCE, "nextIfTrue": "b9"}, "/mission/b1/nextIfTrue", "'b9' does not exist"),
        ({"type": "Barrier", "id": "a", "quorum": "most"}, "/mission/b1/quorum", "'most'"),
        ({"type": "Barrier", "id": "a", "quorum": 0}, "/mission/b1/quorum", ">= 1"),
        ({"type": "Barrier", "id": ""}, "/mission/b1/id", "length >= 1"),
        ({"type": "Barrier", "id": "a", "nextTimeout": "b2"}, "/mission/b1/nextTimeout", "no time-out"),
        ({"type": "Arm", "next": ["b2", "b2"]}, "/mission/b1/next", "only a Fork"),
        ({"type": "Arm", "next": "b9"}, "/mission/b1/next", "'b9' does not exist"),
        ({"type": "Arm", "next": "b0"}, "/mission/b1/next", "the Start"),
        ({"type": "Arm", "next": None}, "/mission/b1", "no `next`"),
        ({"type": "Arm", "on": {"blocked": "b2"}}, "/mission/b1/on/blocked", "does not end with 'blocked'"),
        ({"type": "Arm", "on": {"refused": 2}}, "/mission/b1/on/refused", "expected a block"),
        ({"type": "Arm", "on": []}, "/mission/b1/on", "expected {"),
        ({"type": "Arm", "nextError": []}, "/mission/b1/nextError", "expected a block"),
        ({"type": "Arm", "nextError": "b2", "on": {"error": "b2"}}, "/mission/b1/on/error", "as well"),
        ({"type": "Fork", "next": "b2"}, "/mission/b1/next", "list of successors"),
        ({"type": "Fork", "next": ["b2", "b2"]}, "/mission/b1/next/1", "twice"),
        ({"type": "Decision", "cases": []}, "/mission/b1/cases", "expected a list"),
        ({"type": "Decision", "cases": [{"if": "battery < 1"}]}, "/mission/b1/cases/0", '"next"'),
        ({"type": "Decision", "cases": [{"if": "b <", "next": "b2"}]}, "/mission/b1/cases/0/if", "condition"),
        ({"type": "DecisionRandom", "chanceForTrue": ".3"}, "/mission/b1", "no `nextIfTrue`"),
        (
            {"type": "DecisionRandom", "chanceForTrue": 3, "nextIfTrue": "b2", "nextIfFalse": "b2"},
            "/mission/b1/chanceForTrue",
            "<= 1",
        ),
        ({"type": "Formation", "leader": "u", "course": [[1]]}, "/mission/b1", "pairs"),
        ({"type": "Formation", "leader": "u", "advance": True}, "/mission/b1", "without a course"),
        ({"type": "Formation", "leader": "u", "course": [["x", 1]]}, "/mission/b1/course/0/0", "float"),
        ({"type": "Formation", "leader": "u", "shape": "star"}, "/mission/b1/shape", "'star'"),
        ({"type": "Goto", "x": 1, "y": "$param.far"}, "/mission/b1/y", "$param.far: unknown"),
        ({"type": "Barrier", "id": "$who"}, "/mission/b1/id", "variable $who: unknown"),
    ],
)
def test_mistake_in_block_is_named_with_its_place(block: dict[str, Any], pointer: str, words: str) -> None:
    text = line(block)
    found = [f for f in findings(text) if words in f.message]
    assert found, findings(text)
    assert found[0].pointer == pointer
    assert found[0].line > 1
    assert str(found[0]).startswith(f"m.json:{found[0].line}: {pointer}: ")


@pytest.mark.parametrize(
    ("text", "pointer", "words"),
    [
        ("[]", "", "expected an object"),
        ('{"mission": []}', "", "expected an object"),
        (mission({}), "/mission", "no Start"),
        (mission({"b0": {"type": "Start", "next": "b0"}}), "/mission", "no End"),
        (mission({"b0": 3}), "/mission/b0", "expected a block"),
        (mission({"b0": {"next": "b1"}}), "/mission/b0", "expected a block"),
        (line(misson=1), "/misson", "nearest known: mission"),
        (line(on_failure="dance"), "/on_failure", "land, hold"),
        (line(priority=100), "/priority", "100: expected a whole number from 0 to 99"),
        (line(tolerance_s=-1), "/tolerance_s", "-1: expected a number from 0 to 86400"),
        (line(title=3), "/title", "expected a text"),
        (line(requires="battery"), "/requires", "list of conditions"),
        (line(requires=["battery >"]), "/requires/0", "at its end"),
        (line(params=[]), "/params", "names and default values"),
        (line(params={"a": None}), "/params/a", "expected a number"),
    ],
)
def test_mistake_beside_blocks_is_named_with_its_place(text: str, pointer: str, words: str) -> None:
    assert any(f.pointer == pointer and words in f.message for f in findings(text)), findings(text)


def test_two_starts_are_one_too_many() -> None:
    text = mission(
        {
            "a": {"type": "Start", "next": "c"},
            "b": {"type": "Start", "next": "c"},
            "c": {"type": "End"},
        }
    )
    assert only(text).pointer == "/mission/b"


def test_all_mistakes_are_reported_at_once() -> None:
    text = line({"type": "Wiat"}, {"type": "Takeoff"}, {"type": "Goto", "x": 1})
    with pytest.raises(MissionError) as caught:
        load(text, "m.json", HERE)
    assert len(str(caught.value).splitlines()) == 3


def test_parameters_and_variables_keep_their_type() -> None:
    text = line(
        {"type": "Formation", "leader": "$param.head", "course": "$param.way", "slot": "$param.slot"},
        {"type": "Barrier", "id": "$mission of $param.head at $id"},
        params={"head": "ugv1", "way": [[0, 0], [5, 1]], "slot": 1},
        requires=["battery > $param.slot %"],
    )
    binding = Binding("uav3", PlatformKind.UAV, "air", "survey", {"slot": 4, "way": ((0.0, 0.0), (9.0, 9.0))})
    loaded = load(text, "m.json", binding)
    params = loaded.blocks["b1"].params
    assert isinstance(params, Formation)
    assert (params.leader, params.slot, params.course) == ("ugv1", 4, ((0.0, 0.0), (9.0, 9.0)))
    assert loaded.blocks["b2"].params == catalogue.Barrier(id="survey of ugv1 at uav3")
    assert loaded.requires[0].text == "battery > 4 %"
    assert loaded.resources == {"power/battery"}


def test_parameter_unlike_its_default_is_refused() -> None:
    text = line({"type": "Wait", "s": "$param.s"}, params={"s": 1})
    found = read(text, "m.json", Binding(params={"s": "long"})).findings
    assert [(f.pointer, f.rule) for f in found] == [("/params/s", "param-type")]


def test_mission_shows_which_resources_its_decisions_look_at() -> None:
    text = mission(
        {
            "a": {"type": "Start", "next": "b"},
            "b": {
                "type": "Decision",
                "cases": [{"if": "battery < 30 %", "next": "d"}, {"if": "age(nav/pose) > 1", "next": "d"}],
                "next": "c",
            },
            "c": {"type": "Wait", "s": 1, "next": "b"},
            "d": {"type": "End"},
        }
    )
    loaded = load(text, "m.json", HERE)
    assert loaded.resources == {"power/battery", "nav/pose"}
    assert check_text(text, "m.json", HERE)[1] == []


@given(st.text() | st.text('{}[]:," abmission', max_size=60))
def test_any_text_is_refused_or_has_start(text: str) -> None:
    reading, found = check_text(text, "m.json", HERE)
    if reading.mission is None:
        assert any(finding.severity == "error" for finding in found)
    else:
        assert reading.mission.blocks[reading.mission.start].type == "Start"
    assert all(finding.file == "m.json" and finding.message for finding in found)


NAMES = st.sampled_from(["a", "b", "c", "d", "e"])
VALUES: st.SearchStrategy[Any] = st.one_of(
    NAMES, st.lists(NAMES, max_size=3), st.floats(), st.none(), st.sampled_from(["$id", "$param.x", "3", {}])
)
KEYS = st.sampled_from(
    ["next", "nextTimeout", "nextError", "on", "timeout", "id", "ms", "s", "cases", "nextIfTrue", "x", "y"]
)
BLOCKS = st.builds(
    lambda kind, rest: {"type": kind, **rest},
    st.sampled_from([*catalogue.built_in().types, "Other"]),
    st.dictionaries(KEYS, VALUES, max_size=5),
)


@st.composite
def nearly_sound(draw: st.DrawFn) -> dict[str, Any]:
    """A Start, some blocks and an End with all that they need; now and then one is wrong."""
    middle = ["b", "c", "d"][: draw(st.integers(0, 3))]
    after = st.sampled_from([*middle, "z", *middle, "z", *middle, "z", "a", "missing"])
    plain = st.one_of(
        st.builds(lambda name: {"type": "Wait", "s": 1, "next": name}, after),
        st.builds(lambda name, other: {"type": "Arm", "next": name, "nextError": other}, after, after),
    )
    blocks: dict[str, Any] = {"a": {"type": "Start", "next": draw(after)}, "z": {"type": "End"}}
    blocks |= {name: draw(plain) for name in middle}
    match draw(st.integers(0, 9)):
        case 0:
            blocks["s"] = {"type": "Start", "next": "z"}
        case 1:
            blocks["z"] = {"type": "Wait", "s": 1, "next": "z"}
    return blocks


GRAPHS = st.dictionaries(NAMES, BLOCKS, max_size=5) | nearly_sound()


@settings(max_examples=examples(60, 300))
@given(GRAPHS)
def test_clean_mission_has_start_end_and_successors(
    blocks: dict[str, Any],
) -> None:
    text = json.dumps({"mission": blocks})
    reading, found = check_text(text, "m.json", HERE)
    if not sound(found):
        with pytest.raises(MissionError):
            refuse(tuple(found))
        return
    assert reading.mission is not None
    loaded = reading.mission.blocks
    kinds = [block.type for block in loaded.values()]
    assert kinds.count("Start") == 1
    assert "End" in kinds
    assert all(loaded[edge.target].type != "Start" for block in loaded.values() for edge in block.edges)
    assert all(block.edges or block.type == "End" for block in loaded.values())
