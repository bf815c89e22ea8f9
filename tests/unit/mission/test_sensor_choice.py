"""Which sensors a WaitForSensor means, when a value is enough, and what the check says about it."""

import json
from typing import Any

import pytest

from swarmware.errors import MissionError
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import WaitForSensor
from swarmware.mission.check import check_text
from swarmware.mission.loader import load
from swarmware.mission.sensor_choice import SensorChoice
from swarmware.mission.vocabulary import Vocabulary
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Resource
from swarmware.types.vehicle import Barometer, GnssFix, Imu


def mission(**block: Any) -> str:
    wait = {"type": "WaitForSensor", "next": "e", **block}
    return json.dumps({"mission": {"s": {"type": "Start", "next": "w"}, "w": wait, "e": {"type": "End"}}})


def findings(**block: Any) -> list[str]:
    """Severity and message of each finding of a mission for an aerial vehicle."""
    found = check_text(mission(**block), "m.json", Binding(kind=PlatformKind.UAV))[1]
    return [f"{finding.severity}: {finding.message}" for finding in found]


@pytest.mark.parametrize(
    ("block", "path", "cls", "meant"),
    [
        ({"sensor": "sensor/gnss"}, "sensor/gnss", GnssFix, True),
        ({"sensor": "sensor/gnss"}, "sensor/gnss2", GnssFix, False),
        ({"sensor": "sensor/*"}, "sensor/imu", Imu, True),
        ({"measures": "Barometer"}, "sensor/top/air", Barometer, True),
        ({"measures": "Barometer"}, "sensor/imu", Imu, False),
        ({"measures": "temperature_degc"}, "sensor/air", Barometer, True),
        ({"measures": "temperature_degc"}, "sensor/imu", Imu, False),
        ({"measures": "temperature_degc"}, "sensor/unknown", None, False),
        ({"sensor": "sensor/unknown"}, "sensor/unknown", None, True),
        ({}, "nav/pose", Imu, False),
    ],
)
def test_sensor_is_selected_by_path_or_quantity(
    block: dict[str, str], path: str, cls: Any, meant: bool
) -> None:
    assert SensorChoice(WaitForSensor(**block)).means(path, cls) is meant


@pytest.mark.parametrize(
    ("until", "age_s", "enough"),
    [
        ("", 0.5, True),
        ("", 2.5, False),
        ("satellites >= 6", 0.5, True),
        ("satellites >= 6 and h_acc_m < 1", 0.5, False),
        ("satellites >= 6", 2.5, False),
        ("age() < 0.3", 0.5, False),
        ("speed > 1", 0.5, False),
    ],
)
def test_fresh_value_that_meets_condition_is_enough(until: str, age_s: float, enough: bool) -> None:
    choice = SensorChoice(WaitForSensor(until=until))
    assert choice.suffices(GnssFix(47.0, 8.0, 400.0, 1.5, 8), age_s, 2.0) is enough


def test_package_type_is_known_by_vehicle_template() -> None:
    waits = load(mission(measures="Co2"), "m.json", Binding())
    template = [Resource(path="sensor/co2", type="Co2", rate_hz=1.0)]
    for resources, severity in ((template, "warning"), ([], "error")):
        assert [problem.severity for problem in Vocabulary(resources).check(waits)] == [severity]


def test_template_sensor_is_sound_with_its_fields() -> None:
    assert findings(sensor="sensor/gnss", until="satellites >= 6") == []
    assert findings(measures="GnssFix", until="h_acc_m < 2") == []
    # one of several suffices
    assert findings(sensor="sensor/*", until="satellites >= 6") == []


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (
            {"sensor": "sensor/gns"},
            "warning: sensor sensor/gns is in no template; did you mean 'sensor/gnss'?",
        ),
        ({"measures": "Hygrometer"}, "error: 'Hygrometer' is measured by no sensor that is known here"),
        (
            {"measures": "Baromter"},
            "error: 'Baromter' is measured by no sensor that is known here; did you",
        ),
        (
            {"measures": "MissionState"},
            "warning: sensor sensor/** that measures MissionState is in no",
        ),
        (
            {"sensor": "sensor/gnss", "until": "satelites > 5"},
            "error: condition 'satelites > 5': GnssFix has no",
        ),
        (
            {"sensor": "sensor/gnss", "until": "satellites == 'a'"},
            "error: condition \"satellites == 'a'\": sensor/gnss.satellites is a number",
        ),
    ],
)
def test_what_can_never_be_meant_is_named(block: dict[str, str], expected: str) -> None:
    (found,) = findings(**block)
    assert found.startswith(expected)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ({"sensor": "/uav2/sensor/gnss"}, "expected one of this platform"),
        ({"sensor": "sensor/{a"}, "is not closed"),
        ({"until": "satellites >"}, "at its end"),
        ({"until": "nav/pose.z_m > 3"}, "expected fields of the value of the sensor only"),
    ],
)
def test_parameter_that_no_sensor_can_meet_is_refused(block: dict[str, str], expected: str) -> None:
    with pytest.raises(MissionError, match=expected):
        load(mission(**block), "m.json", Binding())
