"""Values between the wire and people."""

import json
from typing import Any

import msgspec
import pytest

from swarmctl.resources.entering import json_or_text
from swarmctl.resources.values import brief, decoded, field, single
from swarmware.errors import InvalidInput
from swarmware.types import registry
from swarmware.types.json_form import json_form
from swarmware.types.net import NeighbourState, Routes, RouteState
from swarmware.types.scalar import Float
from swarmware.types.vehicle import BatteryState

VALUE: dict[str, Any] = {
    "x_m": 1.5,
    "at": {"lat_deg": 48.0},
    "ranges_m": [1.0, 2.0],
    "none": [],
    "ok": {"sensor/gnss": True},
}


@pytest.mark.parametrize(
    ("fields", "value"),
    [
        ("", VALUE),
        ("x_m", 1.5),
        ("at.lat_deg", 48.0),
        ("ranges_m.1", 2.0),
        ("ranges_m", [1.0, 2.0]),
        ("ranges_m[1]", 2.0),
        ("ok['sensor/gnss']", True),
        ('ok["sensor/gnss"]', True),
        ("at['lat_deg']", 48.0),
    ],
)
def test_a_field_is_found_by_its_dotted_name(fields: str, value: Any) -> None:
    assert field(VALUE, "/uav1/x", fields) == value


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ("y_m", "one of x_m, at, ranges_m"),
        ("at.lon_deg", "one of lat_deg"),
        ("ranges_m.2", "0 to 1"),
        ("ranges_m.-1", "0 to 1"),
        ("none.0", "the list is empty"),
        ("x_m.y", "it is the value 1.5"),
        ("ok['sensor/sonar']", "one of sensor/gnss"),
        ("ranges_m[7]", "0 to 1"),
    ],
)
def test_missing_field_names_existing_fields(fields: str, said: str) -> None:
    with pytest.raises(InvalidInput, match="no field") as caught:
        field(VALUE, "/uav1/x", fields)
    assert said in str(caught.value)


@pytest.mark.parametrize("fields", ["ok[", "ok[sensor/gnss]", "ranges_m[-1]", "ok['a'"])
def test_brackets_have_index_or_key_in_quotes(fields: str) -> None:
    with pytest.raises(InvalidInput, match=r"expected indices such as \[0\], or keys such as"):
        field(VALUE, "/uav1/x", fields)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2.5", 2.5),
        ("-1", -1),
        ("true", True),
        ("land", "land"),
        ('"2.5"', "2.5"),
        ('{"x_m": 1}', {"x_m": 1}),
        ("[1, 2]", [1, 2]),
        ("", ""),
    ],
)
def test_what_is_typed_is_json_or_a_word(text: str, value: Any) -> None:
    assert json_or_text(text) == value


def test_value_that_is_wrapped_alone_stands_for_itself() -> None:
    assert single(Float(2.5)) == 2.5
    battery = BatteryState(11.1, 2.0, 0.5)
    assert single(battery) == {"voltage_v": 11.1, "current_a": 2.0, "remaining_ratio": 0.5}
    assert decoded(BatteryState, registry.encode(battery)) == single(battery)


def test_unknown_type_is_shown_by_position() -> None:
    assert decoded(None, msgspec.msgpack.encode([1, "a"])) == [1, "a"]
    assert decoded(None, b"\xc1") is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (48.1234567, "48.1234567"),
        (0.1 + 0.2, "0.3"),
        ("land", "land"),
        (True, "true"),
        (None, "null"),
        ({"a": [0.1 + 0.2]}, '{"a":[0.3]}'),
    ],
)
def test_value_on_one_line_keeps_centimetre_of_latitude(value: Any, text: str) -> None:
    assert brief(value) == text


def test_json_names_fields_of_wire_arrays() -> None:
    route = RouteState("uav1", 1, "uav1", 256, 1, 0, 5)
    assert "platform" in NeighbourState.__struct_fields__
    assert json.loads(msgspec.json.encode(json_form({"routes": Routes((route,)), "n": (1, None)}))) == {
        "routes": {
            "routes": [
                {
                    "platform": "uav1",
                    "hardware": 1,
                    "via": "uav1",
                    "metric": 256,
                    "hops": 1,
                    "tree_version": 0,
                    "since_ns": "5",
                    "unit": "main",
                }
            ]
        },
        "n": [1, None],
    }
