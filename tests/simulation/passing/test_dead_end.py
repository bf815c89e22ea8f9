"""A vehicle in a dead end plans again once: the free direction next to the commanded one leads nowhere."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import pytest

from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.ground_controller import GroundController
from swarmd.navigator.core.guidance import Guidance
from swarmd.sim.config import GroundLimits, MultirotorLimits
from swarmd.sim.core.ground import Ground
from swarmd.sim.core.multirotor import Multirotor
from swarmware.geometry.world import Bounds, Circle, World
from swarmware.types.navigation import Goal, GoalKind, NavError, NavState, NavStatus
from swarmware.types.vehicle import Pose, Range, VehicleState

STEP_S: Final = 0.05
BEAMS: Final = 72
RANGE_M: Final = 10.0


def wall(*corners: tuple[float, float]) -> Iterator[Circle]:
    """Posts along the lines between these corners, too close to pass between them."""
    for (x0, y0), (x1, y1) in pairwise(corners):
        count = math.ceil(math.dist((x0, y0), (x1, y1)) / 0.5)
        for n in range(count):
            x, y = x0 + (x1 - x0) * n / count, y0 + (y1 - y0) * n / count
            yield Circle(name=f"post_{x:.2f}_{y:.2f}", x_m=x, y_m=y, radius_m=0.2, height_m=2.0)


DEAD_ENDS: Final = {
    "a pocket": ((6, -4), (11, -4), (11, 4), (6, 4)),
    "a corner": ((4, -6), (12, -6), (12, 5)),
    "a long wall": ((9, -9), (9, 9)),
}
RING: Final = ((1.5, -1.5), (1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5), (1.5, -1.5))


class Drive:
    """The real guidance and pilot of a vehicle, its simulated drive and scanner."""

    def __init__(
        self, *corners: tuple[float, float], held: bool = False, x_m: float = 0.0, flies: bool = False
    ) -> None:
        bounds = Bounds(x_m=(-100.0, 100.0), y_m=(-100.0, 100.0), z_m=(-1.0, 10.0))
        self.world = World(description="", bounds=bounds, circles=tuple(wall(*corners)))
        self.config = Config()
        controller = AirController(self.config) if flies else GroundController(self.config)
        self.guidance = Guidance(self.config, "uav1" if flies else "ugv1", controller)
        self.guidance.on_vehicle(VehicleState(armed=True, landed=not flies))
        start = Pose.planar(x_m, 0.0, 1.0 if flies else 0.0)
        self.drive = Multirotor(MultirotorLimits(), start) if flies else Ground(GroundLimits(), start)
        self.drive.armed = True
        self.held = held
        self.now_ns = 1_000_000_000
        self.said: list[NavStatus] = []
        self.gap_m = math.inf

    def go(self, x_m: float, y_m: float, patience_s: float) -> NavStatus:
        """Until the goal is reached or the vehicle says that it is blocked, but not longer than this."""
        self.guidance.on_goal(Goal(1, GoalKind.GOTO, x_m=x_m, y_m=y_m, z_m=1.0, speed_m_s=1.5), self.now_ns)
        for step in range(round(patience_s / STEP_S)):
            self.now_ns += round(STEP_S * 1e9)
            pose = self.drive.pose()
            if step % 2 == 0:
                self._scan(pose)
            output = self.guidance.step(pose, self.now_ns)
            if not self.held:
                self.drive.step(output.setpoint, STEP_S)
            if output.status is not None:
                self.said.append(output.status)
                if output.status.state in {NavState.ARRIVED, NavState.BLOCKED}:
                    break
        return self.said[-1]

    def notes(self) -> list[str]:
        return [note for note in dict.fromkeys(status.note for status in self.said) if note]

    def _scan(self, pose: Pose) -> None:
        lengths = self.world.scan(pose.x_m, pose.y_m, 0.3, pose.yaw_rad, BEAMS, RANGE_M)
        self.guidance.on_scan(Range(-math.pi, math.tau / BEAMS, RANGE_M, tuple(lengths)), self.now_ns)
        gaps = (circle.distance_m(pose.x_m, pose.y_m) for circle in self.world.circles)
        self.gap_m = min(self.gap_m, min(gaps) - self.drive.radius_m)


@pytest.mark.parametrize("flies", [False, True], ids=["ground", "air"])
@pytest.mark.parametrize("name", DEAD_ENDS)
def test_vehicle_in_dead_end_replans_and_arrives(name: str, flies: bool) -> None:
    drive = Drive(*DEAD_ENDS[name], flies=flies)
    status = drive.go(22.0, 0.0, 120.0)
    assert status.state is NavState.ARRIVED, (drive.drive.pose(), drive.notes(), drive.now_ns, status)
    assert drive.gap_m > 0.0


def test_a_dead_end_is_left_by_a_detour() -> None:
    drive = Drive(*DEAD_ENDS["a pocket"])
    drive.go(22.0, 0.0, 120.0)
    assert drive.notes() == ["plans a detour", "detour"]


def test_enclosed_motion_fails_as_blocked() -> None:
    drive = Drive(*RING)
    status = drive.go(22.0, 0.0, 120.0)
    assert (status.state, status.error) == (NavState.BLOCKED, NavError.NO_WAY)
    assert "detour" not in drive.notes()


def test_a_motion_is_planned_anew_only_once() -> None:
    drive = Drive(*DEAD_ENDS["a pocket"], held=True, x_m=8.0)
    status = drive.go(22.0, 0.0, 120.0)
    assert (status.state, status.error) == (NavState.BLOCKED, NavError.NO_WAY)
    assert drive.notes() == ["plans a detour", "detour"]
    assert drive.now_ns < (2 * drive.config.blocked_s + 5) * 1e9


def test_unobstructed_vehicle_is_blocked_at_once() -> None:
    drive = Drive((-20, -20), (-20, -19), held=True)
    status = drive.go(22.0, 0.0, 120.0)
    assert (status.state, status.error) == (NavState.BLOCKED, NavError.NO_WAY)
    assert "detour" not in drive.notes()
