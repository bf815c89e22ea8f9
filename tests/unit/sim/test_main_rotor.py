"""The main rotor: hover, climb, ground effect, stall of the blades, standstill."""

import math

import pytest
from tests.unit.sim.hover import FOOT_M, R50_RADIUS_M, R50_TIP_M_S, Z_COL_FT_S2, Z_W, scale

from swarmd.sim.core.main_rotor import MainRotor
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.helicopter_airframe import AIR_DENSITY_KG_M3, MainRotorConfig

MASS_KG = 14.0
WEIGHT_N = MASS_KG * GRAVITY_M_S2
CONFIG = MainRotorConfig(
    radius_m=R50_RADIUS_M / scale(MASS_KG),
    tip_speed_m_s=R50_TIP_M_S / math.sqrt(scale(MASS_KG)),
    solidity=0.0448,
    collective_mid_rad=0.11,
    collective_span_rad=0.12,
)
HIGH_M = 50.0


def settled(collective: float, along: float = 0.0, climb: float = 0.0, height: float = HIGH_M) -> MainRotor:
    rotor = MainRotor(CONFIG)
    for _ in range(100):
        rotor.step(collective, along, climb, height, 1.0)
    return rotor


def hover_collective() -> float:
    low, high = -1.0, 1.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if settled(middle).thrust_n < WEIGHT_N else (low, middle)
    return low


HOVER = hover_collective()


def test_hover_inflow_matches_momentum_theory() -> None:
    rotor = settled(HOVER)
    area = math.pi * CONFIG.radius_m**2
    assert rotor.inflow_m_s == pytest.approx(math.sqrt(WEIGHT_N / (2 * AIR_DENSITY_KG_M3 * area)), rel=0.01)
    assert rotor.thrust_n == pytest.approx(WEIGHT_N, rel=1e-3)


def test_vertical_control_and_damping_match_flight_data() -> None:
    """The geometry reproduces the measurements of the R-50's flights, scaled to this mass."""
    small = 1e-3
    control = (settled(HOVER + small).thrust_n - settled(HOVER - small).thrust_n) / (2 * small) / MASS_KG
    damping = (settled(HOVER, climb=0.05).thrust_n - settled(HOVER, climb=-0.05).thrust_n) / 0.1 / MASS_KG
    assert control == pytest.approx(Z_COL_FT_S2 * FOOT_M, rel=0.05)
    assert damping == pytest.approx(Z_W * math.sqrt(scale(MASS_KG)), rel=0.05)


@pytest.mark.parametrize(
    ("along", "climb", "height", "more"),
    [
        (10.0, 0.0, HIGH_M, True),
        (0.0, 2.0, HIGH_M, False),
        (0.0, -2.0, HIGH_M, True),
        (0.0, 0.0, 0.0, True),
    ],
    ids=["forward flight", "climb", "descent", "ground effect"],
)
def test_flow_and_ground_change_the_thrust(along: float, climb: float, height: float, more: bool) -> None:
    assert (settled(HOVER, along, climb, height).thrust_n > 1.02 * WEIGHT_N) is more


def test_forward_flight_takes_less_power_than_hover() -> None:
    low, high = -1.0, HOVER
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if settled(middle, 10.0).thrust_n < WEIGHT_N else (low, middle)
    assert settled(low, 10.0).power_w < 0.8 * settled(HOVER).power_w


def test_the_blades_stall_at_the_maximum_thrust() -> None:
    area = math.pi * CONFIG.radius_m**2
    most = CONFIG.thrust_coefficient_max * AIR_DENSITY_KG_M3 * area * CONFIG.tip_speed_m_s**2
    assert settled(1.0, along=15.0).thrust_n == pytest.approx(most, rel=1e-3)
    assert settled(-1.0).thrust_n < 0.0


def test_slow_rotor_does_not_carry() -> None:
    rotor = MainRotor(CONFIG)
    for _ in range(100):
        rotor.step(HOVER, 0.0, 0.0, HIGH_M, 0.5)
    assert rotor.thrust_n < 0.4 * WEIGHT_N
    assert rotor.step(HOVER, 0.0, 0.0, HIGH_M, 0.0) == 0.0
    assert (rotor.inflow_m_s, rotor.power_w) == (0.0, 0.0)
