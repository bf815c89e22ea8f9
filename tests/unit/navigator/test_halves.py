"""Estimator and guidance as two services: over links with a delay they fly as the navigator does."""

import math
import random
from collections.abc import Callable

import pytest

from swarmd.navigator.config import Config
from swarmd.navigator.core.controller import controller
from swarmd.navigator.core.estimator import PoseEstimation
from swarmd.navigator.core.guidance import Guidance
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.navigator.core.pace import Pace
from swarmd.navigator.core.prediction import ReceivedPose, predicted
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.navigation import Goal, GoalKind, NavError, NavState
from swarmware.types.vehicle import GnssFix, Imu, Pose, Setpoint, VehicleState

ORIGIN = Origin(lat_deg=48.0, lon_deg=11.0)
STEP_S = 0.05
Fly = Callable[[Imu, GnssFix, int], tuple[Setpoint, NavState | None]]


def ns(time_s: float) -> int:
    return round(time_s * 1e9)


def lumped(goal: Goal) -> Fly:
    core = NavigatorCore(Config(), "uav1", ORIGIN, controller(PlatformKind.UAV, Config()))
    core.on_vehicle(VehicleState(armed=True, landed=False))
    core.on_goal(goal, ns(1.0))

    def step(imu: Imu, fix: GnssFix, now_ns: int) -> tuple[Setpoint, NavState | None]:
        core.on_imu(imu, now_ns)
        core.on_gnss(fix, now_ns)
        output = core.step(now_ns)
        return output.setpoint, None if output.status is None else output.status.state

    return step


def halves(goal: Goal, *, seed: int = 1) -> Fly:
    """Each value takes 2 to 8 ms: sensors to the estimator, and pose to the guidance."""
    chance = random.Random(seed)
    estimation = PoseEstimation(Config().estimator, ORIGIN, flies=True, hovers=True)
    guidance = Guidance(Config(), "uav1", controller(PlatformKind.UAV, Config()))
    received = ReceivedPose(Config().pose_timeout_s)
    for half in (estimation, guidance):
        half.on_vehicle(VehicleState(armed=True, landed=False))
    guidance.on_goal(goal, ns(1.0))

    def step(imu: Imu, fix: GnssFix, now_ns: int) -> tuple[Setpoint, NavState | None]:
        there_ns = now_ns + ns(chance.uniform(0.002, 0.008))
        estimation.on_imu(imu, now_ns)
        estimation.on_gnss(fix, now_ns)
        estimation.on_setpoint(guidance.setpoint)
        pose = estimation.step(there_ns)
        here_ns = there_ns + ns(chance.uniform(0.002, 0.008))
        if pose is not None:
            received.on_pose(pose, there_ns)
        output = guidance.step(received.at(here_ns), here_ns)
        return output.setpoint, None if output.status is None else output.status.state

    return step


def path(fly: Fly, duration_s: float) -> tuple[list[tuple[float, float, float]], NavState | None]:
    """A vehicle that follows set-points without delay, from 8 m above the origin."""
    chart = LocalMap(ORIGIN)
    truth, points, last = Pose.planar(0.0, 0.0, 8.0), [], None
    for number in range(round(duration_s / STEP_S)):
        fix = GnssFix(*chart.to_wgs84(truth.x_m, truth.y_m, truth.z_m), 0.02, 12)
        imu = Imu(0.0, 0.0, truth.wz_rad_s, 0.0, 0.0, 9.80665, truth.yaw_rad)
        told, state = fly(imu, fix, ns(1.0 + number * STEP_S))
        last = state or last
        yaw = truth.yaw_rad + told.wz_rad_s * STEP_S
        vx = told.vx_m_s * math.cos(yaw) - told.vy_m_s * math.sin(yaw)
        vy = told.vx_m_s * math.sin(yaw) + told.vy_m_s * math.cos(yaw)
        truth = Pose.planar(
            truth.x_m + vx * STEP_S,
            truth.y_m + vy * STEP_S,
            truth.z_m + told.vz_m_s * STEP_S,
            yaw,
            (vx, vy, told.vz_m_s),
            told.wz_rad_s,
        )
        points.append((truth.x_m, truth.y_m, truth.z_m))
    return points, last


@pytest.mark.parametrize("seed", range(5))
def test_delayed_halves_fly_path_of_whole(seed: int) -> None:
    goal = Goal(1, GoalKind.GOTO, 12.0, 5.0, 10.0, speed_m_s=3.0)
    whole, arrived = path(lumped(goal), 15.0)
    parts, also = path(halves(goal, seed=seed), 15.0)
    assert (arrived, also) == (NavState.ARRIVED, NavState.ARRIVED)
    squares = [math.dist(one, other) ** 2 for one, other in zip(whole, parts, strict=True)]
    assert math.sqrt(sum(squares) / len(squares)) < 0.1


def test_pose_is_predicted_until_its_time_out() -> None:
    received = ReceivedPose(0.6)
    assert received.at(ns(5.0)) is None
    received.on_pose(Pose.planar(1.0, 2.0, 3.0, 0.5, (2.0, 0.0, -1.0), 0.2), ns(5.0))
    now = received.at(ns(5.1))
    assert now is not None
    assert (now.x_m, now.y_m, now.z_m) == pytest.approx((1.2, 2.0, 2.9))
    assert now.yaw_rad == pytest.approx(0.52)
    assert received.at(ns(5.59)) is not None
    assert received.at(ns(5.61)) is None
    received.on_pose(Pose.planar(9.0, 9.0, 9.0), ns(4.9))
    late = received.at(ns(5.1))
    assert late is not None
    assert late.x_m == pytest.approx(1.2), "an older estimate came later"


def test_pose_of_clock_ahead_is_unchanged() -> None:
    received = ReceivedPose(0.6)
    pose = Pose.planar(1.0, 0.0, 0.0, 0.0, (5.0, 0.0, 0.0))
    received.on_pose(pose, ns(5.002))
    assert received.at(ns(5.0)) is pose
    assert predicted(pose, 0.0) is pose


@pytest.mark.parametrize(
    ("arrivals_ms", "steps"),
    [
        ((0, 50, 100, 150), 4),
        ((0, 58, 102, 158), 4),
        (tuple(range(0, 1000, 10)), 21),
        ((0, 50, 400, 401, 450), 4),
        ((0, 1, 2), 1),
    ],
)
def test_step_follows_values_at_task_rate(arrivals_ms: tuple[int, ...], steps: int) -> None:
    pace = Pace()
    assert sum(pace.take(ns(1.0 + at_ms / 1e3), STEP_S) for at_ms in arrivals_ms) == steps
    assert pace.wait_s(STEP_S) > STEP_S


def test_without_a_pose_the_guidance_stops_the_vehicle() -> None:
    guidance = Guidance(Config(), "uav1", controller(PlatformKind.UAV, Config()))
    guidance.on_vehicle(VehicleState(armed=True, landed=False))
    guidance.on_goal(Goal(1, GoalKind.GOTO, 12.0, 5.0, 10.0, speed_m_s=3.0), ns(1.0))
    moving = guidance.step(Pose.planar(0.0, 0.0, 10.0), ns(1.1))
    assert moving.setpoint != Setpoint(0.0)
    stopped = guidance.step(None, ns(1.2))
    assert stopped.setpoint == Setpoint(0.0)
    assert stopped.status is not None
    assert stopped.status.error == NavError.NO_POSITION


def test_estimator_rests_only_while_unmoved() -> None:
    estimation = PoseEstimation(Config().estimator, ORIGIN, flies=True, hovers=False)
    estimation.on_vehicle(VehicleState(armed=True, landed=True))
    chart = LocalMap(ORIGIN)

    def noisy(start_s: float, offset_m: float) -> Pose | None:
        pose = None
        for number in range(80):
            now_ns = ns(start_s + number * STEP_S)
            wave = offset_m * (1 if number % 2 else -1)
            estimation.on_imu(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.80665, 0.0), now_ns)
            estimation.on_gnss(GnssFix(*chart.to_wgs84(wave, 0.0, 0.0), 0.02, 12), now_ns)
            pose = estimation.step(now_ns)
        return pose

    at_rest = noisy(1.0, 0.01)
    assert at_rest is not None
    assert at_rest.vx_m_s == 0.0
    estimation.on_control(ControlState(mode=DriveMode.MANUAL, holder="anna"))
    by_hand = noisy(5.0, 0.05)
    assert by_hand is not None
    assert by_hand.vx_m_s != 0.0, "a pilot may move it at any time"
