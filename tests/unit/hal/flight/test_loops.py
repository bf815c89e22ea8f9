"""The loops of the cascade: signs, limits, and rejection of a constant disturbance."""

import math

import msgspec
import pytest
from tests.unit.hal.flight.frames import airframe, state

from swarmd.hal.core.flight.climb_loop import ClimbLoop
from swarmd.hal.core.flight.hover_controller import body_rates, softened
from swarmd.hal.core.flight.rate_loop import RateLoop
from swarmd.hal.core.flight.velocity_loop import VelocityLoop
from swarmware.geometry.geodesy import GRAVITY_M_S2

FRAME = airframe()
GAINS, LIMITS = FRAME.gains, FRAME.limits
DT_S = 0.01


def test_slow_body_is_turned_by_inertia_times_gain() -> None:
    loop = RateLoop((0.02, 0.03, 0.05))
    moment = loop.moment_n_m(GAINS, (0.1, 0.0, -0.1), (0.0, 0.0, 0.0), DT_S, learns=False)
    kp, yaw_kp = GAINS.rate_kp_1_s, GAINS.yaw_rate_kp_1_s
    assert moment == pytest.approx((0.02 * kp * 0.1, 0.0, -0.05 * yaw_kp * 0.1))


def test_gyroscopic_moment_of_turning_body_is_compensated() -> None:
    loop = RateLoop((0.02, 0.03, 0.05))
    rates = (1.0, 2.0, 0.0)
    moment = loop.moment_n_m(GAINS, rates, rates, DT_S, learns=False)
    assert moment == pytest.approx((0.0, 0.0, (0.03 - 0.02) * 1.0 * 2.0))


def test_rate_integral_grows_with_motors_and_is_bounded() -> None:
    loop = RateLoop((1.0, 1.0, 1.0))
    wanted, still = (0.1, 0.0, 0.0), (0.0, 0.0, 0.0)
    first = loop.moment_n_m(GAINS, wanted, still, DT_S, learns=False)[0]
    for _ in range(100):
        held = loop.moment_n_m(GAINS, wanted, still, DT_S, learns=False)[0]
    assert held == first
    for _ in range(100_000):
        grown = loop.moment_n_m(GAINS, wanted, still, DT_S, learns=True)[0]
    assert first < grown <= first + 4.0
    loop.reset()
    assert loop.moment_n_m(GAINS, wanted, still, DT_S, learns=False)[0] == first


def test_tilted_vehicle_returns_within_rate_limit() -> None:
    assert body_rates(state(0.1, -0.1), 0.0, 0.0, 0.0, 4.0, 3.0)[:2] == pytest.approx((-0.4, 0.4), abs=0.02)
    assert body_rates(state(-2.0), 0.0, 0.0, 0.0, 4.0, 3.0)[0] == 3.0


def test_vertical_turn_uses_all_axes_when_tilted() -> None:
    # Euler angles that stay constant in a turn: rates = (-sin θ, sin φ cos θ, cos φ cos θ) ψ'
    roll, pitch, turn = 0.3, 0.2, 0.5
    rates = body_rates(state(roll, pitch), roll, pitch, turn, 4.0, 3.0)
    cos = math.cos(pitch)
    assert rates == pytest.approx(
        (-math.sin(pitch) * turn, math.sin(roll) * cos * turn, math.cos(roll) * cos * turn)
    )


@pytest.mark.parametrize(
    ("wanted", "roll_sign", "pitch_sign"), [((1.0, 0.0), 0, 1), ((-1.0, 0.0), 0, -1), ((0.0, 1.0), -1, 0)]
)
@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, 3.0, -2.0])
def test_velocity_command_tilts_towards_it_at_any_heading(
    wanted: tuple[float, float], roll_sign: int, pitch_sign: int, yaw_rad: float
) -> None:
    roll, pitch = VelocityLoop().tilt_rad(GAINS, LIMITS, wanted, state(yaw_rad=yaw_rad), DT_S)
    tilt = math.atan2(GAINS.velocity_kp_1_s, GRAVITY_M_S2)
    assert (roll, pitch) == pytest.approx((roll_sign * tilt, pitch_sign * tilt), abs=0.01)


def test_velocity_error_never_exceeds_tilt_or_winds_up() -> None:
    loop = VelocityLoop()
    far = state(velocity=(-50.0, 0.0, 0.0))
    for _ in range(1000):
        _, pitch = loop.tilt_rad(GAINS, LIMITS, (5.0, 0.0), far, DT_S)
    assert pitch == pytest.approx(LIMITS.tilt_max_rad)
    assert loop.tilt_rad(GAINS, LIMITS, (0.0, 0.0), state(), DT_S) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_wind_tilt_keeps_its_side_while_turning() -> None:
    loop = VelocityLoop()
    drifting = state(velocity=(0.3, 0.0, 0.0))
    for _ in range(300):
        loop.tilt_rad(GAINS, LIMITS, (0.0, 0.0), drifting, DT_S)
    _, pitch = loop.tilt_rad(GAINS, LIMITS, (0.0, 0.0), state(), DT_S)
    roll, _ = loop.tilt_rad(GAINS, LIMITS, (0.0, 0.0), state(yaw_rad=math.pi / 2), DT_S)
    assert pitch < -0.005  # leans west
    assert roll == pytest.approx(pitch, rel=0.05)  # seen to the north west is left: negative roll
    assert math.hypot(*loop.acceleration_m_s2) < 0.01


def test_a_vehicle_below_its_commanded_height_climbs() -> None:
    loop = ClimbLoop()
    start = loop.acceleration_m_s2(GAINS, LIMITS, 0.0, state(), DT_S)
    low = loop.acceleration_m_s2(GAINS, LIMITS, 0.0, state(position=(0.0, 0.0, 1.8)), DT_S)
    assert start == pytest.approx(0.0)
    assert low == pytest.approx(GAINS.climb_kp_1_s * GAINS.height_kp_1_s * 0.2, rel=0.02)


def test_commanded_height_stays_near_vehicle() -> None:
    loop = ClimbLoop()
    for _ in range(1000):
        loop.acceleration_m_s2(GAINS, LIMITS, 0.0, state(), DT_S)
    lifted = state(position=(0.0, 0.0, 30.0))
    down = loop.acceleration_m_s2(GAINS, LIMITS, 0.0, lifted, DT_S)
    assert down == pytest.approx(-GAINS.climb_kp_1_s * GAINS.height_kp_1_s * 0.3, rel=0.02)


def test_climb_and_sink_rates_have_their_own_limits() -> None:
    up = ClimbLoop().acceleration_m_s2(GAINS, LIMITS, 100.0, state(), DT_S)
    down = ClimbLoop().acceleration_m_s2(GAINS, LIMITS, -100.0, state(), DT_S)
    assert up / -down == pytest.approx(LIMITS.climb_max_m_s / LIMITS.sink_max_m_s, rel=0.02)


def test_integral_carries_unconfigured_weight_and_is_bounded() -> None:
    loop = ClimbLoop()
    sinking = state(velocity=(0.0, 0.0, -0.2))
    first = loop.acceleration_m_s2(GAINS, LIMITS, 0.0, sinking, DT_S)
    for _ in range(10_000):
        last = loop.acceleration_m_s2(GAINS, LIMITS, 0.0, sinking, DT_S)
    assert last - first == pytest.approx(3.0, abs=0.05)


def test_gains_are_softened_for_held_outputs() -> None:
    gains = GAINS
    assert softened(gains, 0.0) is gains
    assert softened(gains, 0.05) == gains, "a loop of 20 Hz is fast enough"
    slow = softened(gains, 0.4)
    assert (slow.rate_kp_1_s, slow.attitude_kp_1_s) == pytest.approx((2.0, 1.0))
    assert (slow.climb_kp_1_s, slow.velocity_kp_1_s) == pytest.approx((2.0, 0.375))
    assert slow.rate_ki_1_s2 == pytest.approx(gains.rate_ki_1_s2 / 49)
    none = msgspec.structs.replace(gains, rate_kp_1_s=0.0, velocity_kp_1_s=0.0, climb_kp_1_s=0.0)
    assert softened(none, 0.4).rate_kp_1_s == 0.0


def test_integral_of_climb_loop_stays_in_fall() -> None:
    gains, limits = GAINS, LIMITS
    loop = ClimbLoop()
    falling = state(velocity=(0.0, 0.0, -5.0))
    first = loop.acceleration_m_s2(gains, limits, 0.0, falling, 0.01)
    for _ in range(100):
        last = loop.acceleration_m_s2(gains, limits, 0.0, falling, 0.01)
    assert last == pytest.approx(first, abs=0.4)


def test_commanded_height_after_gap_is_actual() -> None:
    gains, limits = GAINS, LIMITS
    loop = ClimbLoop()
    loop.acceleration_m_s2(gains, limits, 0.0, state(position=(0.0, 0.0, 5.0)), 0.01)
    below = state(position=(0.0, 0.0, 4.0))
    loop.resume()
    assert loop.acceleration_m_s2(gains, limits, 0.0, below, 0.01) == pytest.approx(0.0, abs=1e-9)
