"""Types of modules in the log, with or without a description."""

import msgspec

from swarmd.logger.core.type_descriptions import KEPT, Definitions, TypeDescriptions
from swarmware.model.resource import Resource
from swarmware.recorder.payload_type import logged_description, payload_class
from swarmware.types.description import describe


class Depth(msgspec.Struct, frozen=True, array_like=True):
    """Depth of the water."""

    depth_m: float
    """Below the hull."""


TEXT = msgspec.json.encode(describe(Depth)).decode()
RESOURCE = Resource(path="sonar/depth", type="Depth", owner="sonar")
KEY = ("sonar/depth", "Depth")


def application(*resources: Resource, text: str = TEXT) -> Definitions:
    return Definitions("sonar#1", resources, {"Depth": text} if text else {})


def test_resource_keeps_description_after_application_ends() -> None:
    types = TypeDescriptions()
    assert types.update([application(RESOURCE)]) == []
    found = types.found
    assert payload_class("Depth", found[KEY]).__struct_fields__ == ("depth_m",)
    assert types.update([]) == [] and types.found is found, "no change: channels of the log stay"


def test_application_without_description_replaces_one_that_had_it() -> None:
    types = TypeDescriptions()
    types.update([application(RESOURCE)])
    types.update([application(RESOURCE, text="")])
    assert types.found == {}


def test_invalid_description_is_reported_once() -> None:
    long = msgspec.json.encode(
        [[["Depth", [[f"field_{n}_{'x' * 150}", "float"] for n in range(500)], "", True]]]
    ).decode()
    for text in ("no JSON", "[[]]", '[[["Depth", [["depth_m", "exec(1)"]]]]]', long):
        types = TypeDescriptions()
        assert types.update([application(RESOURCE, text=text)]) == ["Depth of sonar#1"], text[:40]
        assert types.update([application(RESOURCE, text=text)]) == []
        assert types.found == {KEY: ""}


def test_no_more_than_the_newest_descriptions_are_kept() -> None:
    types = TypeDescriptions()
    for number in range(KEPT + 5):
        types.update([application(Resource(path=f"sonar/{number}", type="Depth"))])
    assert len(types.found) == KEPT and ("sonar/4", "Depth") not in types.found


def test_log_has_fields_of_type_without_meaning() -> None:
    assert "Below the hull" in TEXT and "Depth of the water" in TEXT
    logged = logged_description(TEXT)
    assert "Below the hull" not in logged and "Depth of the water" in logged
    assert logged_description(logged) == logged
