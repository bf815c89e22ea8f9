"""Figures of the report, from synthetic data whose answer is known."""

import math

import numpy as np
import pytest

from swarmlab.measure import tracks
from swarmlab.measure.tracks import Contact, Floats, VehicleTrack


def line(
    platform: str, start: tuple[float, float, float], velocity: tuple[float, float, float]
) -> VehicleTrack:
    """A vehicle on a straight line for ten seconds, seen ten times a second."""
    t_s = np.arange(101) / 10
    xyz = np.array(start) + t_s[:, None] * np.array(velocity)
    yaw = np.full(len(t_s), math.atan2(velocity[1], velocity[0]))
    return VehicleTrack(platform, t_s, xyz, yaw)


def test_resampling_straight_line_is_exact_between_samples() -> None:
    track = line("a", (0, 0, 1), (2, 0, 0))
    got = tracks.resample(track, np.array([0.05, 3.33, 10.0]))
    assert np.allclose(got, np.array([[0.1, 0, 1], [6.66, 0, 1], [20, 0, 1]]))


def test_nothing_is_interpolated_outside_recording_or_over_hole() -> None:
    t_s = np.array([0.0, 1.0, 5.0, 6.0])
    track = VehicleTrack("a", t_s, np.zeros((4, 3)), np.zeros(4))
    got = tracks.resample(track, np.array([-0.1, 0.5, 1.0, 3.0, 5.0, 5.5, 6.1]))
    assert np.isnan(got[:, 0]).tolist() == [True, False, False, True, False, False, True]


def test_a_heading_turns_the_short_way_round() -> None:
    track = VehicleTrack("a", np.array([0.0, 1.0]), np.zeros((2, 3)), np.array([3.1, -3.1]))
    (half,) = tracks.resample_yaw(track, np.array([0.5]))
    assert math.cos(half) == pytest.approx(-1)


def test_an_empty_track_is_nowhere() -> None:
    nowhere = VehicleTrack("a", np.empty(0), np.empty((0, 3)), np.empty(0))
    times = np.array([1.0, 2.0])
    assert np.isnan(tracks.resample(nowhere, times)).all()
    assert np.isnan(tracks.resample_yaw(nowhere, times)).all()


def crossing() -> tuple[dict[str, Floats], Floats]:
    """Two vehicles that pass each other 0.5 m apart at t = 5 s, and a third far above."""
    times = tracks.axis(0, 10)
    vehicles = [
        line("a", (-10, 0, 0), (2, 0, 0)),
        line("b", (10, 0.5, 0), (-2, 0, 0)),
        line("c", (0, 0, 30), (0, 0, 0)),
    ]
    return {track.platform: tracks.resample(track, times) for track in vehicles}, times


def test_closest_two_are_found_where_their_paths_cross() -> None:
    positions, times = crossing()
    found = tracks.closest(positions, times)
    assert found is not None
    assert (found.one, found.other) == ("a", "b")
    assert found.distance_m == pytest.approx(0.5)
    assert found.t_s == pytest.approx(5.0)


def test_vehicles_never_seen_at_once_have_no_separation() -> None:
    times = tracks.axis(0, 1)
    nan = np.full((len(times), 3), np.nan)
    assert tracks.closest({"a": nan, "b": nan}, times) is None


def test_overlapping_spheres_are_one_contact_at_first_instant() -> None:
    positions, times = crossing()
    radii = {"a": 0.3, "b": 0.3, "c": 0.3}
    (contact,) = tracks.touches(positions, radii, times)
    # they overlap when the distance along the road is below √(0.6² − 0.5²) = 0.3317 m, closing at 4 m/s
    assert contact.t_s == pytest.approx(5 - 0.3317 / 4, abs=1 / tracks.RATE_HZ)
    assert not tracks.touches(positions, dict.fromkeys(radii, 0.2), times)


def test_both_sides_reporting_same_touch_is_one_collision() -> None:
    contacts = [
        Contact(1.0, "a", "b"),
        Contact(1.1, "b", "a"),
        Contact(2.9, "a", "b"),
        Contact(1.0, "a", "wall"),
        Contact(9.0, "a", "b"),
    ]
    assert tracks.collisions(contacts) == 3
    assert tracks.collisions([]) == 0


def test_only_instants_inside_the_spans_count() -> None:
    times = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    assert tracks.within(times, [(1.0, 2.0), (4.0, 9.0)]).tolist() == [False, True, True, False, True]
    assert not tracks.within(times, []).any()


def test_percentiles_of_known_numbers() -> None:
    found = tracks.spread([float(i) for i in range(101)])
    assert (found.p50, found.p95, found.p99, found.max, found.mean) == (50, 95, 99, 100, 50)
    assert tracks.spread([]) == tracks.Spread()
