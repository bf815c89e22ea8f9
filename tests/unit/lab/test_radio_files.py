"""Radio files: the shipped ones keep what they promise, mistakes are named, recorded links replace curves."""

from pathlib import Path

import pytest
from tests.unit.lab.radio_rig import SECOND, RadioRig

from swarmlab.radio.core.model import Propagation
from swarmlab.radio.files import find_radio, load_radio
from swarmware.errors import ConfigError, NotFound

CSV = "time_s,distance_m,rate_bit_s,loss_ratio\n"
HEAD = 'description = "d"\nmulticast_rate_bit_s = 1e6\n'


def s3() -> Propagation:
    return Propagation(*load_radio(find_radio("s3")))


def goodput(distance_m: float, *, flies: bool) -> float:
    """Rate times the share of transmissions that are received."""
    quality = s3().quality(distance_m, 0, flies=flies)
    return quality.rate_bit_s * (1 - quality.loss_ratio)


def test_s3_radio_curves_cross_at_160_m() -> None:
    for distance_m in range(0, 160, 10):
        assert goodput(distance_m, flies=True) < goodput(distance_m, flies=False)
    assert goodput(160, flies=True) == goodput(160, flies=False)
    for distance_m in range(170, 400, 10):
        assert goodput(distance_m, flies=True) > goodput(distance_m, flies=False)


@pytest.mark.parametrize("flies", [False, True])
def test_s3_radio_link_is_usable_to_350_m(flies: bool) -> None:
    at_limit, beyond = s3().quality(350, 0, flies=flies), s3().quality(403, 0, flies=flies)
    assert at_limit.rate_bit_s >= 1e6
    assert at_limit.loss_ratio <= 0.4
    assert s3().quality(245, 0, flies=flies).loss_ratio <= 0.03
    assert not beyond.in_range
    before = [goodput(distance_m, flies=flies) for distance_m in range(0, 400, 5)]
    assert before == sorted(before, reverse=True), "nothing gets better with distance"


def test_the_lan_radio_loses_nothing_at_any_distance() -> None:
    quality = Propagation(*load_radio(find_radio("lan"))).quality(1e5, 0, flies=True)
    assert (quality.rate_bit_s, quality.loss_ratio) == (1e9, 0)


def test_unknown_radio_is_refused_with_known_ones(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match=r"--radio s4: .*s4\.toml: no such file; expected one of lan, s3"):
        find_radio("s4")
    own = tmp_path / "own.toml"
    own.write_text(HEAD)
    assert find_radio(str(own)) == own


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "multicast_rate_bit_s"),
        (HEAD + "gain = 3", "gain"),
        (HEAD + "retries = 21", "retries"),
        (HEAD + "ground = [{distance_m = 1, rate_bit_s = 1e6, loss_ratio = 1.5}]", "loss_ratio"),
        (HEAD + "ground = [{distance_m = 1, rate_bit_s = 1e6, loss_ratio = 0}]", "only one has points"),
        (HEAD + 'trace = {file = "x.csv", by = "colour"}', "by"),
        (HEAD + 'trace = {file = "x.csv"}', r"x\.csv: no such file; expected a recorded link as CSV"),
    ],
)
def test_mistake_in_radio_file_is_named(tmp_path: Path, text: str, error: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text if text else 'description = "d"')
    with pytest.raises(ConfigError, match=error) as caught:
        load_radio(path)
    assert str(tmp_path) in str(caught.value)


def test_points_out_of_order_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    far, near = (f"{{distance_m = {at}, rate_bit_s = 1e6, loss_ratio = 0}}" for at in (2, 1))
    path.write_text(f"{HEAD}ground = [{far}, {near}]\nair = [{far}, {near}]")
    with pytest.raises(ConfigError, match="expected ascending"):
        load_radio(path)
    path.write_text(f'{HEAD}ground = [{far}]\nair = [{far}]\ntrace = {{file = "x"}}')
    with pytest.raises(ConfigError, match="replaces the curves"):
        load_radio(path)


@pytest.mark.parametrize(
    ("rows", "error"),
    [
        ("", r"link\.csv: line 1: columns .*; expected time_s,distance_m,rate_bit_s,loss_ratio"),
        (CSV, r"link\.csv: line 1: no rows; expected at least one"),
        (CSV + "0,1,1e6,0\n1,1,fast,0\n", r"link\.csv: line 3: .*rate_bit_s"),
        (CSV + "1,1,1e6,0\n0,1,1e6,0\n", r"link\.csv: line 3: time_s 0 after 1; expected ascending"),
        (CSV + "0,1,1e6\n", r"link\.csv: line 2: 3 values; expected 4"),
        (CSV + "0,1,1e6,0,0\n", r"link\.csv: line 2: 5 values; expected 4"),
        (CSV + "0,1,1e6,nan\n", r"link\.csv: line 2: loss_ratio: .*nan"),
        (CSV + "0,1,0,0\n", r"link\.csv: line 2: key rate_bit_s: expected"),
    ],
)
def test_mistake_in_recorded_link_names_line(tmp_path: Path, rows: str, error: str) -> None:
    (tmp_path / "link.csv").write_text(rows)
    (tmp_path / "own.toml").write_text(HEAD + 'trace = {file = "link.csv"}')
    with pytest.raises(ConfigError, match=error):
        load_radio(tmp_path / "own.toml")


def recorded(folder: Path, by: str) -> RadioRig:
    (folder / "link.csv").write_text(CSV + "0,100,8e6,0\n10,300,4e6,0.2\n20,100,6e6,0.2\n")
    (folder / "own.toml").write_text(f'{HEAD}trace = {{file = "link.csv", by = "{by}"}}')
    model, trace = load_radio(folder / "own.toml")
    return RadioRig(model, trace=trace)


def test_recorded_link_by_distance_is_curve_of_means(tmp_path: Path) -> None:
    rig = recorded(tmp_path, "distance")
    rig.place(gcs=(0, 0, 0), ugv1=(200, 0, 0), uav1=(301, 0, 0))
    half = rig.report("gcs", "ugv1")
    assert half.rate_bit_s == pytest.approx(5.5e6)
    assert half.radio_loss_ratio == pytest.approx(0.15)
    assert rig.report("gcs", "uav1").state == "out of range"


def test_recorded_link_by_time_keeps_last_row(tmp_path: Path) -> None:
    rig = recorded(tmp_path, "time")
    found = []
    for second in (0, 9, 10, 19, 25):
        rig.place(second * SECOND)  # with the next frame, at the latest 0.2 s later
        found.append(rig.report("gcs", "ugv1", second * SECOND).rate_bit_s)
    assert found == [8e6, 8e6, 4e6, 4e6, 6e6]
