"""The navigator's core, which computes pose, set-point and status from measurements and a goal."""

from typing import Final

import msgspec

from swarmd.navigator.config import Config
from swarmd.navigator.core.controller import Controller
from swarmd.navigator.core.estimator import PoseEstimation
from swarmd.navigator.core.guidance import Guidance
from swarmd.navigator.core.pace import TURNS
from swarmware.geometry.geodesy import Origin
from swarmware.runtime.loop_delay import LoopDelay
from swarmware.types.control import ControlState
from swarmware.types.navigation import Goal, NavStatus
from swarmware.types.vehicle import GnssFix, Imu, Pose, Range, Setpoint, VehicleState

_HEIGHT_NS: Final = 1_000_000_000
"""Validity of a measured height, by which a landing without a position descends."""


class NavigatorOutput(msgspec.Struct, frozen=True):
    """The outputs of one control step."""

    pose: Pose | None
    """The estimated pose, or None if it is invalid and not published."""
    setpoint: Setpoint
    status: NavStatus | None
    """Status if it changed or is due, else None."""


class NavigatorCore:
    """Estimation and guidance of one vehicle, computed in one step."""

    def __init__(self, config: Config, platform: str, origin: Origin, controller: Controller) -> None:
        self._config = config
        hovers = controller.flies and controller.circle_m == 0.0
        self._estimation = PoseEstimation(config.estimator, origin, flies=controller.flies, hovers=hovers)
        self._guidance = Guidance(config, platform, controller)
        self._delay = LoopDelay()
        self._height_m: float | None = None
        """Newest height above the ground, or None before the first measurement."""
        self._height_ns: int | None = None
        """Instant of the step that followed the newest height, or None before this step."""

    def set_config(self, config: Config) -> None:
        """Replaces weights and gains, also while moving (S2.46)."""
        self._config = config
        self._guidance.set_config(config)

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None:
        """Takes a position fix."""
        self._estimation.on_gnss(fix, stamp_ns)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Takes rates, specific force and heading."""
        self._estimation.on_imu(imu, stamp_ns)

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground."""
        self._estimation.on_height(height_m)
        self._height_m, self._height_ns = height_m, None

    def on_vehicle(self, state: VehicleState) -> None:
        """Takes the state of the vehicle with armed and landed."""
        self._estimation.on_vehicle(state)
        self._guidance.on_vehicle(state)

    def on_control(self, control: ControlState) -> None:
        """Takes the driver of the vehicle."""
        self._estimation.on_control(control)
        self._guidance.on_control(control)

    def on_scan(self, scan: Range, stamp_ns: int) -> None:
        """Takes a scan of the range sensor."""
        self._guidance.on_scan(scan, stamp_ns)

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None:
        """Takes the pose of another platform, stamped in the own clock."""
        self._guidance.on_neighbour(platform, pose, stamp_ns)

    def on_goal(self, goal: Goal, now_ns: int) -> None:
        """Takes a goal; a repeated goal changes nothing."""
        self._guidance.on_goal(goal, now_ns)

    @property
    def resting(self) -> bool:
        """True if the vehicle is disarmed and on the ground."""
        return self._guidance.resting

    def period_s(self) -> float:
        """Time between two control steps, which is longer for a vehicle that is disarmed and on the
        ground."""
        return self._config.period_s(resting=self.resting)

    def step(self, now_ns: int, late_ns: int = 0) -> NavigatorOutput:
        """Computes pose, set-point and status for this instant; `late_ns`: time since the step was due."""
        self._delay.on_turn(now_ns - late_ns, now_ns)
        delay_ns = self._delay.recent_ns(now_ns)
        # a measurement may have waited for its driver and for this step, both of which were delayed
        late_ns = max(late_ns, TURNS * delay_ns)
        # the set-point in force since the last step, which explains the motion up to now
        self._estimation.on_setpoint(self._guidance.setpoint)
        pose = self._estimation.step(now_ns, late_ns)
        if self._height_ns is None:
            self._height_ns = now_ns
        fresh = now_ns - self._height_ns <= _HEIGHT_NS + late_ns
        output = self._guidance.step(pose, now_ns, delay_ns, self._height_m if fresh else None)
        return NavigatorOutput(pose, output.setpoint, output.status)
