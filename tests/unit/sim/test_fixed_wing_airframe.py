"""The fixed wing as a body: launch from the catapult, touch-down and slide, glide without a motor."""

import math

import pytest
from tests.unit.airframes import aerosonde

from swarmd.sim.core.fixed_wing_airframe import FixedWing
from swarmd.sim.core.flying_body import FlyingBody
from swarmware.geometry.attitude import Vector, to_euler
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Pose

DT = 0.01
OPEN = ActuatorOutputs((1.0,), (0.0, -0.3, 0.0))
CLOSED = ActuatorOutputs((0.0,), (0.0, -0.4, 0.0))


AIRFRAME = aerosonde()


def calm(dt_s: float) -> Vector:
    return 0.0, 0.0, 0.0


def standing(x_m: float = 0.0) -> FlyingBody:
    body = FlyingBody(FixedWing(AIRFRAME), AIRFRAME.body, Pose.planar(x_m, 0.0), calm)
    body.armed = True
    return body


def run(body: FlyingBody, outputs: ActuatorOutputs, seconds: float) -> list[float]:
    return [body.step(outputs, DT) for _ in range(round(seconds / DT))]


def run_down(body: FlyingBody, outputs: ActuatorOutputs) -> None:
    while not body.landed:
        body.step(outputs, DT)


def speed(body: FlyingBody) -> float:
    pose = body.pose()
    return math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s)


def nose_up(body: FlyingBody) -> float:
    pose = body.pose()
    return -to_euler((pose.qx, pose.qy, pose.qz, pose.qw))[1]


def test_aircraft_stands_on_rail_nose_up() -> None:
    body = standing()
    run(body, CLOSED, 1.0)
    assert body.landed and speed(body) == 0.0
    assert nose_up(body) == pytest.approx(-AIRFRAME.body.rest_pitch_rad)


@pytest.mark.parametrize("throttle", [0.5, 0.79])
def test_a_little_throttle_does_not_release_it(throttle: float) -> None:
    body = standing()
    run(body, ActuatorOutputs((throttle,), (0.0, 0.0, 0.0)), 2.0)
    assert body.landed and body.pose().x_m == 0.0


def test_full_throttle_launches_it_along_its_rail() -> None:
    body = standing()
    launcher = AIRFRAME.launcher
    fastest = 0.0
    while body.pose().x_m < 1.2 * launcher.rail_m:
        run(body, OPEN, DT)
        fastest = max(fastest, speed(body))
    assert not body.landed
    assert fastest == pytest.approx(launcher.speed_m_s, rel=0.05)
    assert body.pose().vz_m_s > 1.0
    assert abs(body.pose().y_m) < 0.1


def test_disarmed_aircraft_stays_killed_one_glides() -> None:
    body = standing()
    body.armed = False
    run(body, OPEN, 1.0)
    assert body.pose().x_m == 0.0
    body.armed = True
    run(body, OPEN, 3.0)
    height, place = body.pose().z_m, body.pose()
    body.armed = False
    run_down(body, OPEN)
    way = math.hypot(body.pose().x_m - place.x_m, body.pose().y_m - place.y_m)
    assert way > height, "it has wings"


def test_landed_aircraft_slides_to_rest_and_relaunches() -> None:
    body = standing()
    run(body, OPEN, 0.6)
    run_down(body, CLOSED)
    at, fast = body.pose().x_m, speed(body)
    assert fast > 10.0 and nose_up(body) == pytest.approx(0.0)
    run(body, CLOSED, 10.0)
    way = math.hypot(body.pose().x_m - at, body.pose().y_m)
    assert way == pytest.approx(fast**2 / (2 * AIRFRAME.body.slide_m_s2), rel=0.1)
    assert speed(body) == 0.0
    assert nose_up(body) == pytest.approx(-AIRFRAME.body.rest_pitch_rad)
    run(body, OPEN, 1.0)
    assert not body.landed


def test_its_battery_gives_the_power_of_the_motor() -> None:
    body = standing()
    run(body, CLOSED, 1.0)
    assert body.power_w() == AIRFRAME.idle_w
    run(body, OPEN, 2.0)
    assert 500.0 < body.power_w() < 2500.0
