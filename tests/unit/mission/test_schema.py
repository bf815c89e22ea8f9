"""The shipped JSON Schema: made from the catalogue, and it says what the loader says about form."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from file_schemas import mission_schema
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.simulation.seeds import examples

from swarmware.mission import catalogue
from swarmware.mission.binding import Binding
from swarmware.mission.loader import read
from swarmware.model.config import share_dir

SHIPPED = share_dir() / "schemas" / "mission.schema.json"
PUBLISHED = Path(__file__).parents[2] / "data" / "bdl"
VALIDATOR = jsonschema.Draft202012Validator(json.loads(SHIPPED.read_text()))
MISSIONS = sorted((share_dir() / "missions").rglob("*.json"))


def test_shipped_schema_is_one_of_catalogue() -> None:
    assert SHIPPED.read_text() == mission_schema(), "make docs"
    jsonschema.Draft202012Validator.check_schema(json.loads(SHIPPED.read_text()))


@pytest.mark.parametrize(
    "path",
    [*MISSIONS, *sorted(PUBLISHED.glob("*.json"))],
    ids=str,
)
def test_good_missions_fit_the_schema(path: Path) -> None:
    VALIDATOR.validate(json.loads(path.read_text()))


@pytest.mark.parametrize(
    "text",
    [
        (PUBLISHED / "mission1.json").read_text().replace('"servicename"', '"servicenam"'),
        (PUBLISHED / "mission1.json").read_text().replace("CallAction", "LaunchROS"),
        '{"mission": {"a": {"type": "Start"}}}',
        '{"mission": {"a": {"type": "Wait", "next": "b", "sec": 1}}}',
        '{"mission": {"a": {"type": "Takeoff", "next": "b", "alt": -1}}}',
        '{"mission": {"a": {"type": "Takeoff", "next": "b"}}}',
        '{"mission": {"a": {"type": "Wait", "s": 1, "next": "b", "nextTimeout": "b"}}}',
        '{"mision": {}}',
        '{"priority": 300, "mission": {"a": {"type": "End"}}}',
        '{"mission": {"a": {"type": "Fork", "next": ["b"], "nextError": "b"}}}',
        '{"mission": {"a": {"type": "Land", "next": "b", "timeout": 30}}}',
        '{"mission": {"a": {"type": "Land", "next": "b", "timeout": 30000, "timeout_s": 30}}}',
    ],
)
def test_what_does_not_fit_the_schema_is_refused(text: str) -> None:
    with pytest.raises(jsonschema.ValidationError):
        VALIDATOR.validate(json.loads(text))


# -- what the loader and the schema say about form is the same

BEYOND_FORM = {"no-such-block", "into-start", "start", "end"}
"""Rules about the graph, which no schema can express."""
TARGET = st.sampled_from(["a", "b", "c", "d"])
ANY_TARGET: st.SearchStrategy[Any] = (
    TARGET | st.lists(TARGET, max_size=3) | st.sampled_from([None, 3, True, {}])
)
CASE = st.fixed_dictionaries({"if": st.just("battery < 30 %"), "next": TARGET})
VALUES: dict[str, st.SearchStrategy[Any]] = {
    **dict.fromkeys(("next", "nextTimeout", "next_timeout", "nextError", "next_error"), ANY_TARGET),
    **dict.fromkeys(("nextIfTrue", "nextIfFalse"), ANY_TARGET),
    "on": st.dictionaries(
        st.sampled_from(
            ["timeout", "error", "blocked", "error:blocked", "broken", "refused", "unknown_value", "fire"]
        ),
        ANY_TARGET,
        max_size=3,
    )
    | st.sampled_from([None, [], "a"]),
    **dict.fromkeys(
        ("timeout", "timeout_s"), st.sampled_from([1, 0, -1, 30_000, 90_000, 10**9, "30000", True, None])
    ),
    "cases": st.lists(CASE | TARGET, max_size=2) | st.sampled_from([None, {}, "a"]),
    **dict.fromkeys(("chanceForTrue", "chance_for_true"), st.sampled_from([0.5, ".5", 2, None, True])),
    **dict.fromkeys(
        ("ms", "s", "x", "x_m", "y", "alt", "speed"), st.sampled_from([1, 2.5, "3", True, [], None])
    ),
    "id": st.sampled_from(["m", "", "@m", 3]),
    "quorum": st.sampled_from(["all", "most", 2, 0]),
    "roles": st.lists(st.sampled_from(["air", "ground"]), max_size=2) | st.just("air"),
    "leader": st.sampled_from(["uav1", "", 2]),
    "title": st.sampled_from(["word", 3]),
    "result": st.sampled_from(["done", "failed", "so-so"]),
}
USUAL: dict[str, dict[str, Any]] = {
    "Fork": {"next": ["a", "b"]},
    "Decision": {"next": "a", "cases": [{"if": "battery < 30 %", "next": "b"}]},
    "DecisionRandom": {"chanceForTrue": 0.5, "nextIfTrue": "a", "nextIfFalse": "b"},
    "Barrier": {"next": "a", "id": "m"},
    "Wait": {"next": "a", "s": 1},
    "Takeoff": {"next": "a", "alt": 3},
    "Goto": {"next": "a", "x": 1, "y": 2},
    "Formation": {"next": "a", "leader": "uav1"},
    "End": {},
}


@st.composite
def body(draw: st.DrawFn) -> dict[str, Any]:
    """A block as it should be, with some keys changed, added or taken away."""
    kind = draw(st.sampled_from([*catalogue.built_in().types, "Other"]))
    found = {"type": kind, **USUAL.get(kind, {"next": "a"})}
    for key in draw(st.lists(st.sampled_from(sorted(VALUES)), max_size=3, unique=True)):
        found[key] = draw(VALUES[key])
    for key in draw(st.lists(st.sampled_from(sorted(set(found) - {"type"}) or ["-"]), max_size=1)):
        found.pop(key, None)
    return found


@settings(max_examples=examples(60, 300))
@given(body())
def test_loader_and_schema_agree_about_every_block(block: dict[str, Any]) -> None:
    document = {"mission": {"a": block}}
    findings = [
        finding
        for finding in read(json.dumps(document), "m.json", Binding()).findings
        if finding.rule not in BEYOND_FORM
    ]
    problems = [error.message for error in VALIDATOR.iter_errors(document)]
    assert bool(findings) == bool(problems), (findings, problems)


TOP: dict[str, st.SearchStrategy[Any]] = {
    "title": st.sampled_from(["word", 3, None]),
    "$schema": st.sampled_from(["word", 3]),
    "params": st.sampled_from([{}, {"a": 1}, {"a": None}, [], {"a": {}}]),
    "on_failure": st.sampled_from(["land", "hold", "dance", 3]),
    "requires": st.sampled_from([[], ["battery > 1 %"], [3], "battery"]),
    "priority": st.integers(0, 99),
    "misson": st.just({}),
}


@given(st.fixed_dictionaries({}, optional=TOP))
def test_loader_and_schema_agree_about_keys_beside_blocks(top: dict[str, Any]) -> None:
    document = {"mission": {"a": {"type": "End"}}, **top}
    findings = read(json.dumps(document), "m.json", Binding()).findings
    wrong = any(finding.rule not in BEYOND_FORM for finding in findings)
    assert wrong == (not VALIDATOR.is_valid(document)), findings
