"""Values as text: units beside numbers, angles beside quaternions, no broken word at a narrow terminal."""

import math

import pytest

from swarmctl.resources.fields import Angles, angles_of, attitudes, block, flow, shown_fields
from swarmctl.terminal.wrapping import wrapped

HALF = math.sqrt(0.5)
POSE = {
    "x_m": 1.5,
    "n_m": 3,
    "qx": 0.0,
    "qy": 0.0,
    "qz": HALF,
    "qw": HALF,
    "yaw_rad": math.pi / 2,
    "mode": "auto",
}


@pytest.mark.parametrize(
    ("quaternion", "angles"),
    [
        ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, HALF, HALF), (0.0, 0.0, 90.0)),
        ((0.0, HALF, 0.0, HALF), (0.0, 90.0, 0.0)),
        ((HALF, 0.0, 0.0, HALF), (90.0, 0.0, 0.0)),
        ((0.0, 0.0, -2 * HALF, 2 * HALF), (0.0, 0.0, -90.0)),
    ],
)
def test_a_quaternion_is_shown_as_angles(
    quaternion: tuple[float, float, float, float], angles: tuple[float, float, float]
) -> None:
    found = angles_of(*quaternion)
    assert found is not None
    assert (found.roll_deg, found.pitch_deg, found.yaw_deg) == pytest.approx(angles, abs=0.01)


@pytest.mark.parametrize("quaternion", [(0.0,) * 4, (math.nan,) * 4, (math.inf, 0.0, 0.0, 0.0)])
def test_four_numbers_without_attitude_have_no_angles(
    quaternion: tuple[float, float, float, float],
) -> None:
    assert angles_of(*quaternion) is None


def test_attitudes_are_found_in_types_of_users_too() -> None:
    assert attitudes(POSE) == {"": Angles(0.0, 0.0, 90.0)}
    nested = {"camera": {"rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}, "arm_qx": 0, "arm_qy": 0}
    assert attitudes(nested | {"arm_qz": 0, "arm_qw": 1}).keys() == {"camera.rotation", "arm"}
    assert attitudes({"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}) == {}, "a position may have a w"
    assert attitudes(7.0) == {}


def test_field_has_unit_and_radians_have_degrees() -> None:
    shown = dict(shown_fields(POSE))
    assert shown["x_m"] == "1.5 m"
    assert shown["n_m"] == "3", "a whole number with a short name is a count"
    assert shown["yaw_rad"] == "1.57079633 rad (90.0°)"
    assert shown["attitude"] == "roll 0.0°, pitch 0.0°, yaw 90.0°"
    assert shown_fields(2.5, "kg") == [("", "2.5 kg")]
    assert dict(shown_fields({"gusts": [{"at_s": 1.0}], "empty": [], "list_m": [1.0, 2.0]})) == {
        "gusts.0.at_s": "1 s",
        "empty": "[]",
        "list_m": "1, 2 m",
    }


def test_no_line_exceeds_terminal_or_breaks_words() -> None:
    rows = [*shown_fields(POSE), ("list", ", ".join(str(number) for number in range(100)))]
    words = {word for _, text in rows for word in text.split()}
    for lines in (block(rows, 80), flow(shown_fields(POSE), 80, "2026-11-22T16:05:37.123Z  ")):
        assert max(map(len, lines)) <= 80
        assert {word for line in lines for word in line.split()} >= words & set(" ".join(lines).split())
    assert set(" ".join(block(rows, 80)).split()) >= words
    assert len(flow(rows, None, "")) == 1, "a pipe gets one line per value"
    assert wrapped("a-b " * 30, 20, "", " ")[0].endswith("a-b")


def test_single_value_is_not_indented_and_fields_are() -> None:
    assert block(shown_fields(21.5, "degC"), None) == ["21.5 degC"]
    assert block([("n", "1")], None) == ["  n  1"]
