"""A vehicle with a flight controller that has no position any more comes down in order."""

import pytest
from tests.simulation.flight.vehicle import Flight

from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import WindConfig
from swarmware.types.chassis import ChassisAction
from swarmware.types.navigation import Goal, GoalKind, NavState

HEIGHT_M = 12.0


@pytest.mark.parametrize("kind", [GoalKind.LAND, GoalKind.DESCEND])
@pytest.mark.parametrize("wind_m_s", [0.0, 4.0])
@pytest.mark.parametrize("airframe", ["quad_1k5", "helicopter"])
def test_without_satellites_it_lands_level_and_slowly(airframe: str, wind_m_s: float, kind: GoalKind) -> None:
    wind = WindConfig(mean_m_s=(wind_m_s, 0.0, 0.0), gust_sigma_m_s=wind_m_s / 8)
    flight = Flight(airframe, 7, SimConfig(wind=wind))
    flight.run(2.0)
    assert flight.order(ChassisAction.ARM) == ""
    flight.goal(Goal(1, GoalKind.TAKEOFF, z_m=HEIGHT_M))
    flight.run_until(lambda one: one.status.state is NavState.ARRIVED, 40.0)
    flight.gnss = False
    flight.run(10.0)
    flight.goal(Goal(2, kind, speed_m_s=1.0))
    begun_s, worst_deg, last_m_s = flight.time_s, 0.0, 0.0
    while not flight.simulation.state().landed:
        flight.step()
        worst_deg = max(worst_deg, *map(abs, flight.tilt_deg))
        last_m_s = flight.truth.vz_m_s if flight.truth.z_m > 0.05 else last_m_s
        assert flight.time_s - begun_s < 60.0, f"still at {flight.truth.z_m:.1f} m"
    assert flight.collisions == []
    assert worst_deg < 25.0
    assert last_m_s > -1.0
    flight.run(1.0)
    assert flight.status.state is NavState.ARRIVED
