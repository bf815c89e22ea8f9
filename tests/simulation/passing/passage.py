"""One ground vehicle in virtual time whose slot passes obstacles at the speed of its formation."""

import math
import random
from collections.abc import Sequence
from typing import Final

from swarmd.navigator.config import Config
from swarmd.navigator.core.ground_controller import GroundController
from swarmd.navigator.core.target import Surroundings, Target
from swarmd.sim.config import GroundLimits
from swarmd.sim.core.ground import Ground
from swarmware.geometry.world import Bounds, Circle, World
from swarmware.types.vehicle import Pose

STEP_S: Final = 0.02
BEAMS: Final = 72
RANGE_M: Final = 10.0
RANGE_SIGMA_M: Final = 0.02
POSE_SIGMA_M: Final = 0.02
SPEED_SIGMA_M_S: Final = 0.05
FIX_S: Final = 1.0
"""The error of the position changes as often."""
FIX_SIGMA_M: Final = 0.1
HAS_M: Final = 0.5
"""So near to its slot a vehicle has it."""


def boulders(seed: int) -> list[Circle]:
    """Up to three boulders on the way, one behind the other."""
    chance = random.Random(f"boulders {seed}")
    x_m, found = 10.0, []
    for number in range(chance.choice((1, 1, 2, 3))):
        x_m += chance.uniform(6.0, 18.0) if number else 0.0
        found.append(_boulder(number, x_m, chance.uniform(-1.2, 1.2), chance.uniform(0.2, 0.9)))
    return found


def rubble(seed: int) -> list[Circle]:
    """Up to five boulders that lie across the way and beside each other."""
    chance = random.Random(f"rubble {seed}")
    return [
        _boulder(number, chance.uniform(8.0, 20.0), chance.uniform(-2.5, 2.5), chance.uniform(0.2, 1.2))
        for number in range(chance.randint(1, 5))
    ]


def _boulder(number: int, x_m: float, y_m: float, radius_m: float) -> Circle:
    return Circle(name=f"boulder_{number}", x_m=x_m, y_m=y_m, radius_m=radius_m, height_m=1.0)


class Passage:
    """The real pilot, the simulated drive, a slot that goes straight on along x and does not wait."""

    def __init__(self, circles: Sequence[Circle], seed: object, speed_m_s: float = 2.0) -> None:
        self._chance = random.Random(f"passage {seed}")
        bounds = Bounds(x_m=(-1000.0, 1000.0), y_m=(-1000.0, 1000.0), z_m=(-1.0, 10.0))
        self._world = World(description="", bounds=bounds, circles=tuple(circles))
        self._config = Config()
        self._controller = GroundController(self._config)
        self._drive = Ground(GroundLimits(), Pose.planar(0.0, 0.0))
        self._drive.armed = True
        self._speed_m_s = speed_m_s
        self._fix = (0.0, 0.0)
        self.now_s = 0.0
        self.gap_m = math.inf
        """Least free space to an obstacle so far, or a negative number after a collision."""
        self.worst_m = 0.0
        """Greatest distance to the slot so far."""

    @property
    def behind_m(self) -> float:
        """Distance to the slot."""
        truth = self._drive.pose()
        return math.hypot(self._slot_x_m() - truth.x_m, truth.y_m)

    def drive(self, patience_s: float) -> None:
        """Until the slot is past everything and the vehicle has it again, but not longer than this more."""
        past_s = (max(circle.x_m for circle in self._world.circles) + 3.0) / self._speed_m_s
        self.run(past_s)
        while self.behind_m > HAS_M and self.now_s < past_s + patience_s:
            self.run(1.0)

    def run(self, seconds: float) -> None:
        """Drive for this long."""
        end = self.now_s + seconds
        plan_every = round(1 / self._config.plan_hz / STEP_S)
        step = round(self.now_s / STEP_S)
        setpoint = self._controller.stop() if step == 0 else None
        while self.now_s < end - STEP_S / 2:
            if step % round(FIX_S / STEP_S) == 0:
                gauss = self._chance.gauss
                self._fix = (gauss(0.0, FIX_SIGMA_M), gauss(0.0, FIX_SIGMA_M))
            if step % plan_every == 0 or setpoint is None:
                setpoint = self._controller.steer(
                    self._estimate(), self._target(), self._around(), round(self.now_s * 1e9)
                )
            self._drive.step(setpoint, STEP_S)
            truth = self._drive.pose()
            for circle in self._world.circles:
                gap = circle.distance_m(truth.x_m, truth.y_m) - self._drive.radius_m
                self.gap_m = min(self.gap_m, gap)
            self.worst_m = max(self.worst_m, self.behind_m)
            step += 1
            self.now_s = step * STEP_S

    def _slot_x_m(self) -> float:
        return self._speed_m_s * self.now_s

    def _estimate(self) -> Pose:
        truth, gauss = self._drive.pose(), self._chance.gauss
        state = self._drive.state
        v = state.v_m_s + gauss(0.0, SPEED_SIGMA_M_S)
        return Pose.planar(
            truth.x_m + self._fix[0] + gauss(0.0, POSE_SIGMA_M),
            truth.y_m + self._fix[1] + gauss(0.0, POSE_SIGMA_M),
            0.0,
            state.yaw_rad + gauss(0.0, 0.02),
            (v * math.cos(state.yaw_rad), v * math.sin(state.yaw_rad), 0.0),
            state.w_rad_s,
        )

    def _target(self) -> Target:
        """As the keeper of a formation makes it: it aims a look-ahead beyond the point beside the vehicle."""
        config = self._config
        truth = self._drive.pose()
        speed = math.hypot(truth.vx_m_s, truth.vy_m_s)
        reach = max(config.look_ahead_min_m, speed * config.look_ahead_s)
        return Target(
            self._slot_x_m(),
            0.0,
            0.0,
            0.0,
            math.inf,
            (truth.x_m + reach, 0.0),
            (self._speed_m_s, 0.0, 0.0),
        )

    def _around(self) -> Surroundings:
        """Echoes as the navigator lays them into its map: relative to where it believes to be."""
        truth = self._drive.pose()
        yaw = truth.yaw_rad
        found = []
        for i, length in enumerate(self._world.scan(truth.x_m, truth.y_m, 0.3, yaw, BEAMS, RANGE_M)):
            if length < RANGE_M:
                angle = yaw - math.pi + i * math.tau / BEAMS
                seen = length + self._chance.gauss(0.0, RANGE_SIGMA_M)
                x, y = truth.x_m + seen * math.cos(angle), truth.y_m + seen * math.sin(angle)
                found.append((x + self._fix[0], y + self._fix[1]))
        return Surroundings(tuple(found))
