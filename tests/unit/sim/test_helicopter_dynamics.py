"""The linear hover model: flapping, modes, control, signs."""

import cmath
import math
from collections.abc import Callable

import numpy as np
import pytest
from tests.unit.sim.hover import PUBLISHED, froude, scale

from swarmd.sim.core.helicopter_dynamics import HoverDynamics
from swarmware.geometry.geodesy import GRAVITY_M_S2

DT = 0.0025
ARTIS = froude(14.0)
STILL = (0.0, 0.0, 0.0)


def slope(
    x: list[float],
) -> list[float]:
    """Derivative of u v p q roll pitch a b r gyro, with weight and tilted thrust (forward, right, down)."""
    model = HoverDynamics(ARTIS)
    u, v, p, q, roll, pitch, a, b, r, gyro = x
    model.longitudinal_rad, model.lateral_rad, model.gyro = a, b, gyro
    turning = model.angular((u, v, 0.0), (p, q, r), 0.0, 0.0)
    small = 1e-6
    model.flap(0.0, 0.0, (p, q, r), small)
    return [
        ARTIS.x_u * u - GRAVITY_M_S2 * (pitch + a),
        ARTIS.y_v * v + GRAVITY_M_S2 * (roll + b),
        turning[0],
        turning[1],
        p,
        q,
        (model.longitudinal_rad - a) / small,
        (model.lateral_rad - b) / small,
        turning[2],
        (model.gyro - gyro) / small,
    ]


def modes(f: Callable[[list[float]], list[float]], size: int) -> list[complex]:
    matrix = np.array([f([1.0 if i == j else 0.0 for i in range(size)]) for j in range(size)]).T
    return sorted(np.linalg.eigvals(matrix), key=abs)


def test_modes_are_those_of_small_helicopter_in_hover() -> None:
    """Modes: a slow unstable mode that a controller must damp, and fast stable modes of rotor and
    fuselage."""
    found = modes(slope, 10)
    slow = [value for value in found if abs(value) < 2.0]
    unstable = [value for value in found if value.real > 0.0]
    assert unstable and all(abs(value) < 1.5 for value in unstable)
    assert len(slow) == 4
    fast = [value for value in found if abs(value) > 8.0 and value.imag > 0.0]
    roll, pitch = math.sqrt(ARTIS.l_b), math.sqrt(ARTIS.m_a)
    frequencies = sorted(abs(value) for value in fast)
    assert len(frequencies) == 2
    # the cross coupling of flapping moves the frequencies apart, by less than half
    assert roll < frequencies[1] < 1.5 * roll
    assert pitch < frequencies[0] < 1.5 * pitch
    assert all(0.3 < -math.cos(cmath.phase(value)) < 1.0 for value in fast)


def test_smaller_helicopter_is_faster_by_root_scale() -> None:
    big, small = froude(44.0), ARTIS
    n = scale(14.0)
    assert big.l_b == PUBLISHED["l_b"]
    assert math.sqrt(small.l_b / big.l_b) == pytest.approx(math.sqrt(n))
    assert big.tau_f_s / small.tau_f_s == pytest.approx(math.sqrt(n))


def spun(
    lateral: float = 0.0, longitudinal: float = 0.0, pedal: float = 0.0, seconds: float = 0.5
) -> tuple[float, ...]:
    """Rates after a time with constant controls, the body turning freely."""
    model, rates = HoverDynamics(ARTIS), STILL
    for _ in range(round(seconds / DT)):
        model.flap(lateral, longitudinal, rates, DT)
        turning = model.angular(STILL, rates, 0.0, pedal)
        rates = (rates[0] + turning[0] * DT, rates[1] + turning[1] * DT, rates[2] + turning[2] * DT)
    return rates


def test_controls_act_about_axes_with_source_signs() -> None:
    assert spun(lateral=0.1)[0] > 0.1
    assert spun(longitudinal=0.1)[1] < -0.1
    assert spun(pedal=0.1)[2] > 0.1


def test_roll_rate_settles_at_control_over_lag() -> None:
    only = {"a_b": 0.0, "b_a": 0.0, "a_lat": 0.0, "b_lon": 0.0}
    model, p = HoverDynamics(type(ARTIS)(**{**{f: getattr(ARTIS, f) for f in PUBLISHED}, **only})), 0.0
    for _ in range(round(1.0 / DT)):
        model.flap(0.2, 0.0, (p, 0.0, 0.0), DT)
        p += model.angular(STILL, (p, 0.0, 0.0), 0.0, 0.0)[0] * DT
    assert p == pytest.approx(0.2 * ARTIS.b_lat / ARTIS.tau_f_s, rel=0.02)


def test_gyro_takes_away_pedal_while_tail_swings() -> None:
    model = HoverDynamics(ARTIS)
    for _ in range(round(1.0 / DT)):
        model.flap(0.0, 0.0, (0.0, 0.0, 1.0), DT)
    assert model.gyro == pytest.approx(-ARTIS.k_r / ARTIS.k_rfb, rel=0.02)
    damped = model.angular(STILL, (0.0, 0.0, 1.0), 0.0, 0.0)[2]
    assert damped == pytest.approx(ARTIS.n_r - ARTIS.n_ped * model.gyro)


def test_a_rotor_that_stops_is_level() -> None:
    model = HoverDynamics(ARTIS)
    model.flap(0.5, 0.5, (0.1, 0.1, 0.1), 0.1)
    model.stop()
    assert (model.longitudinal_rad, model.lateral_rad, model.gyro) == STILL
