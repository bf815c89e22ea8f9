"""Two paths are compared in space, and at the same time since the begin of each phase of the mission."""

import numpy as np
import pytest

from swarmlab.distribution import DistributionReport, InputDelay, VehicleDifference, phases
from swarmlab.measure.path_difference import PathDifference, VehicleRun, difference
from swarmlab.measure.tracks import VehicleTrack
from swarmware.types.mission import MissionPhase, MissionState


def flown(start_s: float, *, aside_m: float = 0.0, end_s: float = 20.0, wait_s: float = 0.0) -> VehicleRun:
    """At rest until the start, then to the east for 5 s, a pause, and to the north."""
    t_s = np.arange(0.0, end_s, 0.05)
    east_s = np.clip(t_s - start_s, 0.0, 5.0)
    turn_s = start_s + 5.0 + wait_s
    north_s = np.clip(t_s - turn_s, 0.0, None)
    xyz_m = np.stack([east_s**1.5, north_s + aside_m, np.zeros_like(t_s)], axis=1)
    track = VehicleTrack("uav1", t_s, xyz_m, np.zeros_like(t_s))
    return VehicleRun(track, {"east": start_s, "north": turn_s})


def compared(one: VehicleRun, other: VehicleRun) -> PathDifference:
    found = difference(one, other)
    assert found is not None
    return found[0]


def test_later_phase_equals_and_path_aside_differs() -> None:
    found = compared(flown(2.0), flown(3.3, wait_s=0.7))
    assert found.same_time_rms_m < 0.01
    assert [phase.phase for phase in found.phases] == ["east", "north"]
    assert [phase.later_s for phase in found.phases] == pytest.approx([1.3, 2.0])
    aside = compared(flown(2.0), flown(2.0, aside_m=0.5))
    assert aside.same_time_rms_m == pytest.approx(0.5, abs=0.01)
    assert aside.max_m == pytest.approx(0.5, abs=0.05)


def test_vehicle_late_within_phase_differs_in_time() -> None:
    one = flown(2.0)
    late = VehicleRun(flown(2.5).track, one.phases)
    found = compared(one, late)
    assert found.rms_m < 0.1
    assert found.same_time_rms_m > 0.4


def test_a_missing_path_or_phase_has_no_difference() -> None:
    empty = VehicleTrack("uav1", np.empty(0), np.empty((0, 3)), np.empty(0))
    nothing = VehicleRun(empty, {})
    assert difference(flown(1.0), nothing) is None
    assert difference(nothing, flown(1.0)) is None
    assert difference(flown(1.0), VehicleRun(flown(1.0).track, {"elsewhere": 1.0})) is None


def test_phase_is_sole_active_block_after_command() -> None:
    def state(*active: str) -> MissionState:
        return MissionState(1, "", MissionPhase.RUNNING, active)

    seen = [(-0.1, state("arm")), (0.5, state("arm", "form")), (1.0, state("form")), (2.0, state("land"))]
    assert phases([*seen, (3.0, state("form")), (4.0, state())]) == {"form": 1.0, "land": 2.0}


@pytest.mark.parametrize(
    ("rms_m", "same_time_m", "collisions", "missed"),
    [
        (0.1, 0.19, (0, 0), []),
        (0.19, 0.25, (0, 0), []),
        (0.3, 0.1, (0, 0), ["uav1: 0.30 m; expected at most 0.2 m"]),
        (0.1, 0.1, (0, 2), ["uav1: 2 collisions; expected none"]),
    ],
)
def test_the_distance_in_space_and_collisions_decide(
    rms_m: float, same_time_m: float, collisions: tuple[int, int], missed: list[str]
) -> None:
    paths = PathDifference(rms_m, 1.0, same_time_m, ())
    one = VehicleDifference("uav1", ("main", "nav", "fc"), paths, collisions)
    assert DistributionReport((2.0, 8.0), 0.2, (one,)).misses() == missed


def test_vehicle_on_one_computer_is_not_judged() -> None:
    far = VehicleDifference("ugv1", ("main",), PathDifference(9.0, 9.0, 9.0, ()), (0, 0))
    gone = VehicleDifference("uav1", ("main", "nav", "fc"), None, (0, 0))
    assert DistributionReport((2.0, 8.0), 0.2, (far,)).misses() == []
    assert DistributionReport((2.0, 8.0), 0.2, (gone,), ("lost",)).misses() == [
        "lost",
        "uav1: a path is missing",
    ]


@pytest.mark.parametrize(
    ("mean_ms", "p99_ms", "missed"),
    [
        (13.0, 28.0, []),
        (13.1, 20.0, ["uav1.nav: sensor/imu after 13.1 ms, p99 20.0 ms"]),
        (9.0, 28.1, ["uav1.nav: sensor/imu after 9.0 ms, p99 28.1 ms"]),
    ],
)
def test_a_delay_is_judged_beside_the_simulated_one(mean_ms: float, p99_ms: float, missed: list[str]) -> None:
    imu = InputDelay("uav1", "sensor/imu", "nav", 100, mean_ms, p99_ms, 40.0)
    goal = "; expected at most 8 and 20 ms beside the simulated delay"
    assert DistributionReport((2.0, 8.0), 0.2, (), inputs=(imu,)).misses() == [one + goal for one in missed]
