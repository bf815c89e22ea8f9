"""Conditions: what they mean, with values missing, and what is refused."""

import contextlib

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import MissionError
from swarmware.mission.condition_parser import parse
from swarmware.mission.field_path import Scalar, scalar_of


class Scalars(msgspec.Struct, frozen=True):
    """A value inside another one."""

    value: float


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
        ("absent(sensor/gone.value)", True),
        ("absent(battery)", False),
        ("not absent(sensor/gone.value) or altitude < 0", True),
    ],
)
def test_a_condition_means_what_it_says(text: str, expected: bool | None) -> None:
    assert parse(text).holds(HERE) is expected


class Drone(msgspec.Struct, frozen=True):
    """A value with a map, lists and a value inside."""

    sensors: dict[str, bool]
    faults: tuple[str, ...]
    points: tuple[tuple[float, ...], ...]
    motors: tuple[Scalars, ...]
    by_level: dict[int, str]


DRONE = Drone(
    {"sensor/gnss": True, "nav.pose": False, "gnss": True, 'a"b': True, "sensor/imu": False}
    | {"left/range": True, "right/range": True},
    ("flight/tilt=bad", "0"),
    ((1.0, 2.0), (3.0,)),
    (Scalars(7.0), Scalars(8.0)),
    {3: "three"},
)


class OfDrone:
    """Its fields as a resource."""

    def value(self, path: str, field: str) -> Scalar | None:
        return scalar_of(DRONE, field) if path == "my/drone" else None

    def age_s(self, path: str) -> float | None:
        return None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('my/drone.sensors["sensor/gnss"]', True),
        ("my/drone.sensors['sensor/gnss'] == true", True),
        ("my/drone.sensors[ 'nav.pose' ]", False),
        ("my/drone.sensors.gnss", True),
        ('my/drone.sensors.imu == "valid"', False),
        ("my/drone.sensors.imu == 'invalid'", True),
        ("'valid' != my/drone.sensors.imu", True),
        ("my/drone.sensors.gnss == 'true'", None),
        ("my/drone.sensors['imu']", None),
        ("my/drone.sensors.range == 'valid'", None),
        ("my/drone.sensors.sonar == 'valid'", None),
        ("my/drone.sensors['a\"b']", True),
        ("my/drone.sensors['sensor/sonar']", None),
        ("not my/drone.sensors['sensor/sonar']", None),
        ("absent(my/drone.sensors['sensor/sonar'])", True),
        ("absent(my/drone.sensors['nav.pose'])", False),
        ("my/drone.sensors", None),
        ("my/drone.faults['flight/tilt=bad']", True),
        ("my/drone.faults['flight/loop=late']", False),
        ("my/drone.faults['0']", True),
        ("my/drone.faults[0] == 'flight/tilt=bad'", True),
        ("my/drone.faults[9] == 'flight/tilt=bad'", None),
        ("my/drone.points[1][0] == 3", True),
        ("my/drone.points[1][1] == 3", None),
        ("my/drone.motors[1].value == 8", True),
        ("my/drone.motors.1.value == 8", True),
        ("my/drone.motors['value'] == 8", False),
        ("my/drone.by_level[3] == 'three'", True),
        ("my/drone['sensors']", None),
        ("my/drone.sensors.get", None),
        ("other/drone.sensors.gnss", None),
    ],
)
def test_element_of_map_or_list_is_value(text: str, expected: bool | None) -> None:
    assert parse(text).holds(OfDrone()) is expected


def test_only_field_is_indexed_by_its_resource() -> None:
    class Levels(msgspec.Struct, frozen=True):
        levels: tuple[float, ...]

    assert scalar_of(Levels((1.0, 2.0)), "[1]") == 2.0
    assert scalar_of(Levels((1.0, 2.0)), "levels[1]") == 2.0


def test_bracketed_field_is_read_on_one_resource() -> None:
    condition = parse("sensors['sensor/gnss'] and age() < 1", "/uav1/health/state")
    assert [(one.path, one.field, one.age) for one in condition.operands()] == [
        ("/uav1/health/state", "sensors['sensor/gnss']", False),
        ("/uav1/health/state", "", True),
    ]


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
        ("health/state.sensors[", "at '[', column 21: expected an index such as [0], or a key in quotes"),
        ("health/state.sensors[sensor/gnss]", "expected an index such as [0], or a key in quotes such as"),
        ("health/state.faults[-1] == 'x'", "expected an index such as [0]"),
        ("absent(3)", "expected a field of a resource"),
        ("absent(battery", "expected )"),
        (
            "age(nav/pose.x_m) > 1",
            "expected a resource path without a field: its fields are as old as nav/pose",
        ),
        ("battery[0] > 1", "at 'battery[0]', column 1"),
    ],
)
def test_invalid_condition_is_refused_with_place(text: str, word: str) -> None:
    with pytest.raises(MissionError, match="condition") as caught:
        parse(text)
    assert word in str(caught.value)


@given(st.text(max_size=60) | st.text("ab/.<>=()[]' 1%ornt", max_size=40))
def test_any_text_is_a_condition_or_our_error(text: str) -> None:
    with contextlib.suppress(MissionError):
        assert parse(text).holds(HERE) in (True, False, None)
