"""A vehicle with an airframe: rotors with lag, ground, hard landings, wind, motors that are off."""

import math
import random
from pathlib import Path
from statistics import mean, stdev

import pytest

from swarmd.sim.config import WindConfig
from swarmd.sim.core.flying_body import FlyingBody
from swarmd.sim.core.multirotor_airframe import MultirotorRotors
from swarmd.sim.core.rigid_body import RigidBody
from swarmd.sim.core.simulation import GustyWind
from swarmware.geometry.attitude import Vector
from swarmware.model.airframe import MultirotorAirframe
from swarmware.model.airframe_file import load_airframe
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Pose

SHARE = Path(__file__).parents[3] / "share/swarm"
BOTH = pytest.mark.parametrize("name", ["quad_1k5", "hexa_14k"])
CALM: Vector = (0.0, 0.0, 0.0)
DT_S = 0.005


def frame(name: str = "quad_1k5") -> MultirotorAirframe:
    found = load_airframe(SHARE, name)
    assert isinstance(found, MultirotorAirframe)
    return found


def vehicle(name: str = "quad_1k5", height_m: float = 0.0, wind: Vector = CALM) -> FlyingBody:
    airframe = frame(name)
    start = Pose.planar(0.0, 0.0, height_m)
    made = FlyingBody(MultirotorRotors(airframe), airframe.body, start, lambda _: wind)
    made.armed = True
    return made


def hover(airframe: MultirotorAirframe, ratio: float = 1.0) -> ActuatorOutputs:
    """Outputs whose thrust is this ratio of the weight."""
    share = ratio * airframe.hover_thrust_n / (airframe.motor.thrust_max_n * len(airframe.rotors))
    return ActuatorOutputs((math.sqrt(share),) * len(airframe.rotors))


def fly(flown: FlyingBody, outputs: ActuatorOutputs, duration_s: float) -> float:
    """The hardest impact within a time."""
    return max(flown.step(outputs, DT_S) for _ in range(round(duration_s / DT_S)))


@BOTH
def test_thrust_above_weight_lifts_vehicle(name: str) -> None:
    flown = vehicle(name)
    fly(flown, hover(frame(name), 0.98), 2.0)
    assert flown.landed
    assert flown.pose() == Pose.planar(0.0, 0.0)
    fly(flown, hover(frame(name), 1.1), 2.0)
    assert flown.pose().z_m > 0.5


@BOTH
def test_thrust_of_hover_carries_it_once_rotors_turn(name: str) -> None:
    flown = vehicle(name, 50.0)
    tau_s = frame(name).motor.tau_s
    fly(flown, hover(frame(name)), 5 * tau_s)
    sinking = flown.pose().vz_m_s
    fly(flown, hover(frame(name)), 1.0)
    assert flown.pose().vz_m_s == pytest.approx(sinking, rel=0.2)
    assert flown.power_w() == pytest.approx(frame(name).motor.hover_w + frame(name).motor.idle_w, rel=0.01)


@pytest.mark.parametrize(
    ("stronger", "roll", "pitch", "yaw"),
    [((2, 1), 1, 0, 0), ((1, 3), 0, 1, 0), ((2, 3), 0, 0, 1), ((0, 1), 0, 0, -1)],
    ids=["left", "rear", "clockwise", "counter-clockwise"],
)
def test_stronger_rotors_turn_the_body(stronger: tuple[int, int], roll: int, pitch: int, yaw: int) -> None:
    airframe = frame()
    rotors = MultirotorRotors(airframe)
    body = RigidBody(1.5, airframe.body.inertia_kg_m2, CALM, 0.0)
    outputs = ActuatorOutputs(tuple(0.8 if index in stronger else 0.7 for index in range(4)))
    for _ in range(200):
        _, moment = rotors.loads(outputs, body, CALM, DT_S)
    for found, sign in zip(moment, (roll, pitch, yaw), strict=True):
        assert (found > 0.05) == (sign > 0)
        assert (found < -0.05) == (sign < 0)


def test_rotor_speed_follows_output_with_time_constant() -> None:
    airframe = frame()
    rotors = MultirotorRotors(airframe)
    body = RigidBody(1.5, airframe.body.inertia_kg_m2, CALM, 0.0)
    force, _ = rotors.loads(ActuatorOutputs((1.0,) * 4), body, CALM, airframe.motor.tau_s)
    assert force[2] == pytest.approx(4 * airframe.motor.thrust_max_n * (1 - math.exp(-1)) ** 2)


def test_outputs_beyond_their_range_are_limited() -> None:
    airframe = frame()
    rotors = MultirotorRotors(airframe)
    body = RigidBody(1.5, airframe.body.inertia_kg_m2, CALM, 0.0)
    force, _ = rotors.loads(ActuatorOutputs((7.0, 7.0, -3.0, -3.0)), body, CALM, 10.0)
    assert force[2] == pytest.approx(2 * airframe.motor.thrust_max_n)


def test_wind_carries_hovering_vehicle_along() -> None:
    flown = vehicle(height_m=100.0, wind=(3.0, -1.0, 0.0))
    fly(flown, hover(frame()), 1.0)
    soon = flown.pose()
    assert 0.2 < soon.vx_m_s < 1.0
    assert soon.vy_m_s == pytest.approx(-soon.vx_m_s / 3, rel=0.2)
    fly(flown, hover(frame()), 40.0)
    assert flown.pose().vx_m_s == pytest.approx(3.0, abs=0.1)


def test_a_turn_is_damped_by_the_air() -> None:
    airframe = frame()
    rotors = MultirotorRotors(airframe)
    body = RigidBody(1.5, airframe.body.inertia_kg_m2, CALM, 0.0)
    body.rates_rad_s = (1.0, 0.0, -2.0)
    _, moment = rotors.loads(ActuatorOutputs(), body, CALM, DT_S)
    assert moment == pytest.approx((-0.003, 0.0, 0.004))


def test_falling_vehicle_collides_on_impact() -> None:
    flown = vehicle(height_m=5.0)
    fly(flown, hover(frame()), 0.5)
    flown.armed = False
    impact_m_s = fly(flown, hover(frame()), 3.0)
    assert impact_m_s == pytest.approx(math.sqrt(2 * 9.81 * 5.0), rel=0.1)
    assert flown.landed
    assert flown.rates() == (0.0, 0.0, 0.0)


def test_soft_landing_is_no_collision_unlike_tipped() -> None:
    soft = vehicle(height_m=0.05)
    assert fly(soft, hover(frame(), 0.9), 2.0) == 0.0
    assert soft.landed
    tipped = vehicle(height_m=1.0)
    lopsided = ActuatorOutputs((0.3, 0.8, 0.8, 0.3))
    assert fly(tipped, lopsided, 3.0) > 0.0
    pose = tipped.pose()
    assert (pose.qx, pose.qy) == pytest.approx((0.0, 0.0))


def test_at_an_obstacle_it_stops_with_its_attitude() -> None:
    flown = vehicle(height_m=5.0)
    fly(flown, ActuatorOutputs((0.7, 0.75, 0.75, 0.7)), 0.2)
    before = flown.pose()
    assert before.qx != 0.0
    flown.stop_at(1.0, 2.0, 3.0)
    after = flown.pose()
    assert (after.x_m, after.y_m, after.z_m, after.vz_m_s, after.wz_rad_s) == (1.0, 2.0, 3.0, 0.0, 0.0)
    assert (after.qx, after.qw) == (before.qx, before.qw)


def test_gusts_have_configured_strength_and_duration_about_mean() -> None:
    wind = GustyWind(
        WindConfig(mean_m_s=(2.0, 0.0, 0.0), gust_sigma_m_s=1.5, gust_tau_s=2.0), random.Random(3).gauss
    )
    found = [wind(0.1) for _ in range(40_000)]
    assert mean(v[0] for v in found) == pytest.approx(2.0, abs=0.15)
    for axis in range(3):
        values = [v[axis] for v in found]
        assert stdev(values) == pytest.approx(1.5, rel=0.1)
        middle = mean(values)
        later = mean((a - middle) * (b - middle) for a, b in zip(values, values[20:], strict=False))
        assert later / stdev(values) ** 2 == pytest.approx(math.exp(-1), abs=0.07)


def test_without_gusts_the_wind_is_steady() -> None:
    wind = GustyWind(WindConfig(mean_m_s=(1.0, 2.0, 0.0)), random.Random(3).gauss)
    assert {wind(0.1) for _ in range(10)} == {(1.0, 2.0, 0.0)}
