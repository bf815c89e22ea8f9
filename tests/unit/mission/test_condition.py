"""Conditions: what they mean, with values missing, and what is refused."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import MissionError
from swarmware.mission.condition import Scalar, parse


class Values:
    """Fixed values of a few resources."""

    def __init__(self, values: dict[str, Scalar], ages: dict[str, float] | None = None) -> None:
        self._values = values
        self._ages = ages or {}

    def value(self, path: str, field: str) -> Scalar | None:
        return self._values.get(f"{path}.{field}")

    def age_s(self, path: str) -> float | None:
        return self._ages.get(path)


HERE = Values(
    {
        "power/battery.remaining_ratio": 0.25,
        "nav/pose.z_m": -2.0,
        "vehicle/state.armed": True,
        "vehicle/state.mode": "auto",
        "/uav2/nav/pose.x_m": 7.0,
    },
    {"nav/pose": 0.5},
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("battery < 80 %", True),
        ("BatteryLevel < 20%", False),
        ("power/battery.remaining_ratio >= 0.25", True),
        ("altitude < -1.5", True),
        ("vehicle/state.armed", True),
        ("not vehicle/state.armed", False),
        ("vehicle/state.mode == 'auto'", True),
        ("vehicle/state.mode != 'auto'", False),
        ('vehicle/state.mode == "auto"', True),
        ('vehicle/state.mode == "it\'s"', False),
        ("vehicle/state.armed == true", True),
        ("/uav2/nav/pose.x_m > 5", True),
        ("age(nav/pose) < 1", True),
        ("age(nav/pose) > 1 or battery < 30 %", True),
        ("age(nav/pose) > 1 or battery < 20 % and true", False),
        ("(age(nav/pose) > 1 or battery < 30 %) and not (altitude > 0)", True),
        ("sensor/gone.value < 1", None),
        ("age(sensor/gone) < 1", None),
        ("not sensor/gone.value < 1", None),
        ("sensor/gone.value < 1 or true", True),
        ("sensor/gone.value < 1 and false", False),
        ("sensor/gone.value < 1 and true", None),
        ("vehicle/state.mode < 3", None),
        ("battery", None),
    ],
)
def test_a_condition_means_what_it_says(text: str, expected: bool | None) -> None:
    assert parse(text).holds(HERE) is expected


def test_a_condition_names_the_resources_it_looks_at() -> None:
    condition = parse("battery < 1 and (age(nav/pose) < 2 or not /gcs/health/state.level == 'ok')")
    assert condition.resources() == {"power/battery", "nav/pose", "/gcs/health/state"}


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "at its end"),
        ("battery <", "at its end, column 10"),
        ("battery < 1 and  speed > 3", "at 'speed', column 18"),
        ('vehicle/state.mode == "auto', "column 23"),
        ("age() > 1", "resource path"),
        ("battery < 80 % 3", "expected and, or"),
        ("(battery < 1", "expected )"),
        ("speed > 3", "resource path"),
        ("3", "comparison"),
        ("battery ~ 3", "'~ 3'"),
        ("age(3) > 1", "resource path"),
        ("Nav/Pose.z > 1", "resource path"),
        ("not " * 50 + "true", "nested"),
        ("(" * 50 + "true" + ")" * 50, "nested"),
        ("x" * 600, "at most"),
    ],
)
def test_what_is_no_condition_is_refused_with_its_place(text: str, word: str) -> None:
    with pytest.raises(MissionError, match="condition") as caught:
        parse(text)
    assert word in str(caught.value)


@given(st.text(max_size=60) | st.text("ab/.<>=()' 1%ornt", max_size=40))
def test_any_text_is_a_condition_or_our_error(text: str) -> None:
    with contextlib.suppress(MissionError):
        assert parse(text).holds(HERE) in (True, False, None)
