"""A file of a helicopter or aircraft that could not fly is refused with the key and the expected value."""

from pathlib import Path

import pytest

from swarmware.errors import ConfigError
from swarmware.model.airframe_file import load_airframe

SHARE = Path(__file__).parents[2] / "share/swarm"


def refused(tmp_path: Path, name: str, old: str, new: str) -> str:
    folder = tmp_path / "airframes"
    folder.mkdir()
    text = (SHARE / f"airframes/{name}.toml").read_text("utf-8")
    assert old in text
    (folder / "mine.toml").write_text(text.replace(old, new), "utf-8")
    with pytest.raises(ConfigError) as caught:
        load_airframe(tmp_path, "mine")
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "key", "expected"),
    [
        ("mass_kg = 14.0", "mass_kg = 40.0", "key rotor: the collective in hover is", "expected -1 to 0.6"),
        ("tip_speed_m_s = 115.5", "tip_speed_m_s = 60.0", "key rotor", "mass, radius, tip speed"),
        ("a_lon = -0.1", "a_lon = 0.0031", "key derivatives", "controls about two axes"),
        ("l_b = 243.2", "l_b = 0.0", "derivatives.l_b", "> 0"),
        ("n_ped = 48.48\n", "", "n_ped", "missing"),
    ],
)
def test_a_helicopter_that_could_not_hover_is_refused(
    tmp_path: Path, old: str, new: str, key: str, expected: str
) -> None:
    message = refused(tmp_path, "helicopter", old, new)
    assert "mine.toml" in message and key in message and expected in message


@pytest.mark.parametrize(
    ("old", "new", "key", "expected"),
    [
        ("airspeed_min_m_s = 18.5", "airspeed_min_m_s = 15.5", "airspeed_min_m_s: 15.5", "stalls at 15.1"),
        ("airspeed_max_m_s = 28.0", "airspeed_max_m_s = 20.0", "key limits", "in this order"),
        ("loiter_radius_m = 90.0", "loiter_radius_m = 40.0", "loiter_radius_m: 40", "0.8 of bank_max_rad"),
        ("speed_m_s = 20.0", "speed_m_s = 9.0", "launcher.speed_m_s: 9", "more than the stall at 15.1"),
        ("mass_kg = 11.0", "mass_kg = 30.0", "airspeed_min_m_s", "expected at least"),
        ("roll_kp = 1.5", "roll = 1.5", "gains", "roll"),
    ],
)
def test_an_aircraft_that_would_stall_is_refused(
    tmp_path: Path, old: str, new: str, key: str, expected: str
) -> None:
    message = refused(tmp_path, "fixed_wing", old, new)
    assert "mine.toml" in message and key in message and expected in message
