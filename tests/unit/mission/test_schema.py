"""The shipped JSON Schema: made from the catalogue, and it says what the loader says about form."""

import json
from pathlib import Path

import jsonschema
import pytest

from swarmware.config import share_dir
from swarmware.mission.schema import mission_schema

SHIPPED = share_dir() / "schemas" / "mission.schema.json"
PUBLISHED = Path(__file__).parents[2] / "data" / "bdl"
MISSIONS = sorted((share_dir() / "missions").rglob("*.json"))


def test_the_shipped_schema_is_the_one_of_the_catalogue() -> None:
    # make it again: print(swarmware.mission.schema.mission_schema(), end="")
    assert SHIPPED.read_text() == mission_schema()
    jsonschema.Draft202012Validator.check_schema(json.loads(SHIPPED.read_text()))


@pytest.mark.parametrize(
    "path",
    [*MISSIONS, PUBLISHED / "decision_test_mission.json", PUBLISHED / "join_test_mission.json"],
    ids=str,
)
def test_good_missions_fit_the_schema(path: Path) -> None:
    jsonschema.validate(json.loads(path.read_text()), json.loads(SHIPPED.read_text()))


@pytest.mark.parametrize(
    "text",
    [
        (PUBLISHED / "mission1.json").read_text(),
        '{"mission": {"a": {"type": "Start"}}}',
        '{"mission": {"a": {"type": "Wait", "next": "b", "sec": 1}}}',
        '{"mission": {"a": {"type": "Takeoff", "next": "b", "alt": -1}}}',
        '{"mission": {"a": {"type": "Takeoff", "next": "b"}}}',
        '{"mission": {"a": {"type": "Wait", "s": 1, "next": "b", "nextTimeout": "b"}}}',
        '{"mision": {}}',
    ],
)
def test_what_does_not_fit_the_schema_is_refused(text: str) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(json.loads(text), json.loads(SHIPPED.read_text()))
