"""Two paths are compared at the same time since their start."""

import numpy as np
import pytest

from swarmlab.measure.path_difference import difference
from swarmlab.measure.tracks import VehicleTrack


def track(start_s: float, *, aside_m: float = 0.0, end_s: float = 20.0) -> VehicleTrack:
    """At rest until the start, then with a growing speed to the east."""
    t_s = np.arange(0.0, end_s, 0.05)
    moved_s = np.clip(t_s - start_s, 0.0, None)
    xyz_m = np.stack([moved_s**1.5, np.full_like(t_s, aside_m), np.zeros_like(t_s)], axis=1)
    return VehicleTrack("uav1", t_s, xyz_m, np.zeros_like(t_s))


def test_a_later_start_is_no_difference_and_a_path_aside_is() -> None:
    found = difference(track(2.0), track(3.3))
    assert found is not None
    assert found[0].same_time_rms_m < 0.01
    assert found[0].shift_s == pytest.approx(1.3, abs=0.02)
    aside = difference(track(2.0), track(2.0, aside_m=0.5))
    assert aside is not None
    assert aside[0].rms_m == pytest.approx(0.5, abs=0.01)
    assert aside[0].max_m == pytest.approx(0.5, abs=0.05)
    assert aside[0].same_time_rms_m == pytest.approx(0.5, abs=0.01)


def test_a_vehicle_that_is_late_on_the_same_path_differs_in_time_only() -> None:
    slow = track(2.0)
    late = VehicleTrack("uav1", slow.t_s * 1.1, slow.xyz_m, slow.yaw_rad)
    found = difference(slow, late)
    assert found is not None
    assert found[0].rms_m < 0.2 < found[0].same_time_rms_m


def test_a_missing_path_has_no_difference() -> None:
    nothing = VehicleTrack("uav1", np.empty(0), np.empty((0, 3)), np.empty(0))
    assert difference(track(0.0), nothing) is None
    assert difference(nothing, track(0.0)) is None
    assert difference(track(0.0), track(0.0, end_s=3.0)) is None
