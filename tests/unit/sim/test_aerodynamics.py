"""Aerodynamics of the fixed wing: lift, stall, glide, trim, modes, propeller."""

import math

import numpy as np
import pytest
from tests.unit.airframes import aerosonde

from swarmd.sim.core.aerodynamics import (
    Deflections,
    air_loads,
    drag_coefficient,
    lift_coefficient,
    propeller,
)
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.fixed_wing_airframe import AIR_DENSITY_KG_M3

STRAIGHT = Deflections(0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)


AIRCRAFT = aerosonde()
WING = AIRCRAFT.wing
WEIGHT_N = AIRCRAFT.body.mass_kg * GRAVITY_M_S2


def balance(speed: float, climb: float, x: np.ndarray) -> np.ndarray:
    """Forces along and across the body and pitching moment, at an angle of attack, elevator and throttle."""
    alpha, elevator, throttle = x
    u, w = speed * math.cos(alpha), speed * math.sin(alpha)
    force, moment = air_loads(WING, AIRCRAFT.lateral, (u, 0.0, w), STILL, Deflections(0.0, elevator, 0.0))
    pitch = alpha + math.asin(climb / speed)
    thrust = propeller(AIRCRAFT.propeller, throttle, u)[0]
    return np.array(
        [
            force[0] + thrust - WEIGHT_N * math.sin(pitch),
            force[2] + WEIGHT_N * math.cos(pitch),
            moment[1],
        ]
    )


def trim(speed: float, climb: float = 0.0) -> tuple[float, float, float]:
    x = np.array([0.05, -0.1, 0.5])
    for _ in range(50):
        now = balance(speed, climb, x)
        columns = [(balance(speed, climb, x + step) - now) / 1e-6 for step in np.eye(3) * 1e-6]
        x = x - np.linalg.solve(np.array(columns).T, now)
    assert np.abs(balance(speed, climb, x)).max() < 1e-6
    return float(x[0]), float(x[1]), float(x[2])


@pytest.mark.parametrize("climb", [0.0, AIRCRAFT.limits.climb_max_m_s])
@pytest.mark.parametrize("speed", ["min", "cruise", "max"])
def test_flight_and_climb_trim_within_servo_limits(speed: str, climb: float) -> None:
    airspeed = getattr(AIRCRAFT.limits, f"airspeed_{speed}_m_s")
    alpha, elevator, throttle = trim(airspeed, climb)
    assert 0.0 < alpha < 0.6 * WING.stall_rad
    assert abs(elevator) < 0.8 * AIRCRAFT.surfaces.elevator_max_rad
    assert 0.3 < throttle < 1.0


def test_cruise_throttle_of_file_is_trim() -> None:
    limits = AIRCRAFT.limits
    level = trim(limits.airspeed_cruise_m_s)[2]
    climbing = trim(limits.airspeed_cruise_m_s, 2.0)[2]
    assert level == pytest.approx(limits.throttle_cruise_ratio, abs=0.01)
    assert (climbing - level) / 2.0 == pytest.approx(limits.throttle_climb_s_m, rel=0.1)


def test_lift_falls_beyond_stall_and_drag_jumps() -> None:
    angles = [step / 1000 for step in range(700)]
    lifts = [lift_coefficient(WING, alpha) for alpha in angles]
    best = angles[lifts.index(max(lifts))]
    assert 1.2 < max(lifts) < 1.6
    assert 0.7 * WING.stall_rad < best < WING.stall_rad
    assert lift_coefficient(WING, WING.stall_rad + 0.1) < 0.7 * max(lifts)
    assert drag_coefficient(WING, WING.stall_rad + 0.1) > 1.3 * drag_coefficient(WING, best)
    assert lift_coefficient(WING, -0.5) == pytest.approx(-2 * math.sin(0.5) ** 2 * math.cos(0.5), abs=0.01)


def test_stall_speed_follows_from_largest_lift() -> None:
    most = max(lift_coefficient(WING, step / 1000) for step in range(400))
    stall = math.sqrt(2 * WEIGHT_N / (AIR_DENSITY_KG_M3 * WING.area_m2 * most))
    assert AIRCRAFT.stall_m_s == pytest.approx(stall, rel=0.05)
    assert AIRCRAFT.limits.airspeed_min_m_s > 1.15 * stall


def test_unpowered_glide_follows_lift_over_drag() -> None:
    ratios = [lift_coefficient(WING, a / 100) / drag_coefficient(WING, a / 100) for a in range(20)]
    assert 12.0 < max(ratios) < 20.0


def lateral_rates(x: np.ndarray, speed: float, alpha: float) -> list[float]:
    """Derivative of side speed, roll rate, yaw rate and roll: axes forward, right, down."""
    v, p, r, roll = x
    u, w = speed * math.cos(alpha), speed * math.sin(alpha)
    force, moment = air_loads(WING, AIRCRAFT.lateral, (u, v, w), (p, 0.0, r), STRAIGHT)
    ix, _, iz = AIRCRAFT.body.inertia_kg_m2
    return [
        force[1] / AIRCRAFT.body.mass_kg + GRAVITY_M_S2 * math.sin(roll) + w * p - u * r,
        moment[0] / ix,
        moment[2] / iz,
        p + r * math.tan(alpha),
    ]


def test_lateral_modes_are_dutch_roll_and_spiral() -> None:
    speed = AIRCRAFT.limits.airspeed_cruise_m_s
    alpha = trim(speed)[0]
    step = 1e-5
    columns = [
        (np.array(lateral_rates(d, speed, alpha)) - np.array(lateral_rates(-d, speed, alpha))) / (2 * step)
        for d in np.eye(4) * step
    ]
    found = np.linalg.eigvals(np.array(columns).T)
    oscillating = [value for value in found if value.imag > 0.1]
    real = sorted(value.real for value in found if abs(value.imag) < 0.1)
    assert len(oscillating) == 1 and oscillating[0].real < 0.0
    assert 2.0 < abs(oscillating[0]) < 10.0
    assert real[0] < -8.0, "roll subsides fast"
    assert abs(real[1]) < 0.3, "the spiral is slow"


def test_pitch_is_stable_and_damped() -> None:
    def moment(alpha: float, q: float = 0.0) -> float:
        air = (22 * math.cos(alpha), 0.0, 22 * math.sin(alpha))
        return air_loads(WING, AIRCRAFT.lateral, air, (0.0, q, 0.0), STRAIGHT)[1][1]

    assert moment(0.12) < moment(0.06) < moment(0.0)
    assert moment(0.06, 0.5) < moment(0.06)


@pytest.mark.parametrize(
    ("surfaces", "axis", "sign"),
    [
        (Deflections(0.1, 0.0, 0.0), 0, 1),
        (Deflections(0.0, 0.1, 0.0), 1, -1),
        (Deflections(0.0, 0.0, 0.1), 2, -1),
    ],
    ids=["aileron", "elevator", "rudder"],
)
def test_deflections_turn_about_their_axes(surfaces: Deflections, axis: int, sign: int) -> None:
    air = (22.0, 0.0, 1.0)
    with_it = air_loads(WING, AIRCRAFT.lateral, air, STILL, surfaces)[1][axis]
    without = air_loads(WING, AIRCRAFT.lateral, air, STILL, STRAIGHT)[1][axis]
    assert sign * (with_it - without) > 1.0


def test_side_slip_turns_nose_into_wind() -> None:
    force, moment = air_loads(WING, AIRCRAFT.lateral, (22.0, 2.0, 1.0), STILL, STRAIGHT)
    assert force[1] < 0.0 and moment[2] > 0.0


def test_air_at_rest_gives_no_force() -> None:
    assert air_loads(WING, AIRCRAFT.lateral, (0.1, 0.1, 0.1), STILL, STRAIGHT) == (STILL, STILL)


def test_an_aircraft_that_falls_backwards_has_finite_forces() -> None:
    for air in ((-30.0, 0.0, 0.0), (0.0, 30.0, 0.0), (0.0, 0.0, -30.0), (-1.0, 0.0, 1e-9)):
        force, moment = air_loads(WING, AIRCRAFT.lateral, air, (3.0, 3.0, 3.0), STRAIGHT)
        assert all(math.isfinite(value) for value in (*force, *moment))


def test_thrust_falls_with_airspeed_and_rises_with_throttle() -> None:
    full, half = (propeller(AIRCRAFT.propeller, ratio, 20.0) for ratio in (1.0, 0.7))
    standing = propeller(AIRCRAFT.propeller, 1.0, 0.0)
    assert standing[0] > full[0] > half[0] > 0.0
    assert full[2] > half[2] > half[0] * 20.0, "the battery gives more than the propeller"
    assert propeller(AIRCRAFT.propeller, 0.0, 20.0) == (0.0, 0.0, 0.0)
