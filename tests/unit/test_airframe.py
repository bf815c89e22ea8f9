"""Files of airframes: those that are installed are sound; an error names file, key and the expected value."""

from pathlib import Path

import pytest

from swarmware.errors import ConfigError
from swarmware.model.airframe_file import load_airframe

SHARE = Path(__file__).parents[2] / "share/swarm"
INSTALLED = sorted(path.stem for path in (SHARE / "airframes").glob("*.toml"))


@pytest.mark.parametrize("name", INSTALLED)
def test_each_installed_airframe_is_valid(name: str) -> None:
    assert load_airframe(SHARE, name).body.mass_kg > 0.0


def test_airframes_of_both_weights_exist() -> None:
    masses = {load_airframe(SHARE, name).body.mass_kg for name in INSTALLED}
    assert masses >= {1.5, 14.0}


def changed(tmp_path: Path, old: str, new: str) -> Path:
    """A share folder whose only airframe is quad_1k5 with a change."""
    folder = tmp_path / "airframes"
    folder.mkdir()
    text = (SHARE / "airframes/quad_1k5.toml").read_text("utf-8")
    assert old in text
    (folder / "mine.toml").write_text(text.replace(old, new), "utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type = "multirotor"', "", r"mine\.toml: key type: missing; expected one of multirotor"),
        ('type = "multirotor"', 'type = "kite"', r"mine\.toml: key type: 'kite'; expected one of multirotor"),
        ("mass_kg = 1.5", "mass_kg = -1.5", r"mine\.toml: line \d+: key body\.mass_kg: .*> 0"),
        ("mass_kg = 1.5", "", r"mine\.toml:.*body.*mass_kg"),
        (
            "mass_kg = 1.5",
            "mass_kg = 2.6",
            r"mine\.toml: .*28\.3 N at a weight of 25\.5 N; expected at least 1\.2",
        ),
        (
            "x_m = 0.13",
            "x_m = -0.13",
            r"mine\.toml: .*x_m from -0\.13 to -0\.13; expected rotors on both sides",
        ),
        ('turns = "cw"', 'turns = "ccw"', r"mine\.toml: .*all turn ccw; expected cw and ccw"),
        ('turns = "cw"', 'turns = "left"', r"mine\.toml:.*rotors\[2\]\.turns.*left"),
        ("rate_kp_1_s = 14.0", "rate_kp = 14.0", r"mine\.toml:.*gains.*rate_kp"),
        ("control_hz = 100.0", "control_hz = 10.0", r"mine\.toml: line 8: key control_hz: .*>= 50"),
    ],
)
def test_airframe_that_cannot_fly_is_refused_with_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load_airframe(changed(tmp_path, old, new), "mine")


def test_three_rotors_are_not_enough(tmp_path: Path) -> None:
    text = (SHARE / "airframes/quad_1k5.toml").read_text("utf-8")
    before, *rotors = text.split("[[rotors]]")
    last, _, after = rotors[-1].partition("[gains]")
    assert "turns" in last
    (tmp_path / "airframes").mkdir()
    (tmp_path / "airframes/tri.toml").write_text("[[rotors]]".join([before, *rotors[:3]]) + "[gains]" + after)
    with pytest.raises(ConfigError, match="key rotors: 3 given; expected at least 4"):
        load_airframe(tmp_path, "tri")


def test_unknown_airframe_is_refused_with_known_ones(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"quad\.toml: no airframe 'quad'; expected one of .*hexa_14k.*quad_1k5"
    ):
        load_airframe(SHARE, "quad")
    with pytest.raises(ConfigError, match="none is installed"):
        load_airframe(tmp_path, "quad")
