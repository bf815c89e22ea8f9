"""The charge for the way home, from distance, speeds and the measured discharge."""

import pytest

from swarmd.mission.core.way_home import LEVELLING_S, MARGIN, WayHomeEstimate
from swarmware.types.vehicle import Pose

S = 1_000_000_000
HOME = Pose.planar(1.0, 1.0, 0.0)


def flown(*charges: tuple[float, float]) -> WayHomeEstimate:
    """An estimate after these instants in s with these charges."""
    estimate = WayHomeEstimate(0.1)
    for at_s, ratio in charges:
        estimate.on_charge(ratio, round(at_s * S))
    return estimate


@pytest.mark.parametrize(
    ("charges", "rate"),
    [
        ((), None),
        (((0, 0.9),), None),
        (((0, 0.9), (9, 0.8)), None),
        (((0, 0.9), (10, 0.8)), 0.01),
        (((0, 0.9), (10, 0.9)), None),
        (((0, 0.9), (100, 0.8), (130, 0.5)), 0.01),
        (((0, 0.9), (10, 0.8), (20, 0.99), (25, 0.9)), None),
        (((0, 0.9), (10, 0.8), (20, 0.99), (40, 0.89)), 0.005),
    ],
)
def test_discharge_covers_two_minutes_of_one_battery(
    charges: tuple[tuple[float, float], ...], rate: float | None
) -> None:
    assert flown(*charges).discharge_1_s == (None if rate is None else pytest.approx(rate))


@pytest.mark.parametrize(
    ("pose", "flies", "distance_m", "way_s"),
    [
        (Pose.planar(1.0, 1.0, 5.0), True, 0.0, 3.5 / 1.0 + 1.5 / 0.5),
        (Pose.planar(41.0, 31.0, 5.0), True, 50.0, 50 / 2.0 + 3.5 / 1.0 + 1.5 / 0.5),
        (Pose.planar(21.0, 1.0, 0.5), True, 20.0, 20 / 2.0 + 1.5 / 1.5 + 0.5 / 1.0 + 1.5 / 0.5),
        (Pose.planar(21.0, 1.0, 0.5), False, 20.0, 20 / 2.0),
    ],
)
def test_way_home_is_return_and_landing(pose: Pose, flies: bool, distance_m: float, way_s: float) -> None:
    found = flown((0, 0.9), (20, 0.8)).estimate(pose, HOME, flies=flies)
    assert found is not None
    assert (found.distance_m, found.remaining_ratio) == (distance_m, 0.8)
    assert found.duration_s == pytest.approx(way_s * MARGIN + LEVELLING_S, abs=0.06)
    assert found.needed_ratio == pytest.approx(0.1 + 0.005 * (way_s * MARGIN + LEVELLING_S), abs=2e-4)


def test_without_a_discharge_the_need_is_not_known() -> None:
    assert WayHomeEstimate(0.1).estimate(HOME, HOME, flies=True) is None
    found = flown((0, 0.9)).estimate(HOME, HOME, flies=True)
    assert found is not None
    assert found.needed_ratio is None


def test_resting_vehicle_has_no_flight_discharge() -> None:
    estimate = flown((0, 0.9), (20, 0.8))
    estimate.on_disarmed()
    assert estimate.discharge_1_s is None
