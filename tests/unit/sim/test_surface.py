"""The surface vessel: speed and yaw rate answered slowly, a slip outwards in turns, a drift to rest."""

import math
import random

import pytest

from swarmd.sim.config import Config, SurfaceLimits
from swarmd.sim.core.simulation import model
from swarmd.sim.core.surface import Surface
from swarmware.errors import InvalidInput
from swarmware.geometry.world import World
from swarmware.model.config import load, share_dir
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.vehicle import Pose, Setpoint

DT = 0.02


def vessel(armed: bool = True) -> Surface:
    made = model(Config(), PlatformKind.USV, Pose.planar(0.0, 0.0))
    assert isinstance(made, Surface)
    made.armed = armed
    return made


def go(made: Surface, wanted: Setpoint, seconds: float) -> None:
    for _ in range(round(seconds / DT)):
        made.step(wanted, DT)


def test_a_disarmed_vessel_stays() -> None:
    made = vessel(armed=False)
    go(made, Setpoint(2.0, 0.0, 0.0, 1.0), 2.0)
    assert made.pose() == Pose.planar(0.0, 0.0)


def test_limits_hold_whatever_is_asked() -> None:
    made, limits, chance = vessel(), SurfaceLimits(), random.Random(1)
    before = made.state
    for _ in range(3000):
        made.step(Setpoint(chance.uniform(-9, 9), 5.0, 5.0, chance.uniform(-9, 9)), DT)
        state = made.state
        assert -limits.v_back_m_s - 1e-9 <= state.surge_m_s <= limits.v_max_m_s + 1e-9
        assert abs(state.w_rad_s) <= limits.w_max_rad_s + 1e-9
        assert abs(state.surge_m_s - before.surge_m_s) <= limits.a_max_m_s2 * DT + 1e-9
        before = state
    assert made.pose().z_m == 0.0


def test_fast_turn_slips_outwards_and_decays() -> None:
    made = vessel()
    go(made, Setpoint(2.0), 5.0)
    assert made.state.surge_m_s == pytest.approx(2.0, abs=0.01)
    assert made.state.sway_m_s == 0.0
    go(made, Setpoint(2.0, 0.0, 0.0, 0.5), 3.0)
    assert made.state.sway_m_s < -0.1, "to the right in a turn to the left"
    go(made, Setpoint(2.0), 5.0)
    assert made.state.sway_m_s == pytest.approx(0.0, abs=0.01)


def test_position_is_integral_of_stated_velocity() -> None:
    made, x_m, y_m = vessel(), 0.0, 0.0
    for _ in range(500):
        heading = made.state.yaw_rad
        made.step(Setpoint(1.5, 0.0, 0.0, 0.6), DT)
        state = made.state
        x_m += (state.surge_m_s * math.cos(heading) - state.sway_m_s * math.sin(heading)) * DT
        y_m += (state.surge_m_s * math.sin(heading) + state.sway_m_s * math.cos(heading)) * DT
    assert (made.pose().x_m, made.pose().y_m) == pytest.approx((x_m, y_m))


def test_without_power_it_drifts_to_a_standstill() -> None:
    made = vessel()
    go(made, Setpoint(2.0), 5.0)
    made.armed = False
    go(made, Setpoint(2.0), 8.0)
    assert made.state.surge_m_s == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("world", sorted(path.stem for path in (share_dir() / "worlds").glob("*.toml")))
@pytest.mark.parametrize("kind", ["uav", "ugv", "usv"])
def test_every_vehicle_has_start_in_every_world(world: str, kind: str) -> None:
    found = load(share_dir() / "worlds" / f"{world}.toml", World)
    poses = [found.start_pose(kind, number) for number in range(1, 6)]
    for pose in poses:
        assert found.bounds.contains(pose.x_m, pose.y_m, 0.0)
        assert found.touching(pose.x_m, pose.y_m, 0.0, 1.0) is None
    assert len({(pose.x_m, pose.y_m) for pose in poses}) == 5


def test_what_has_no_body_is_not_simulated() -> None:
    with pytest.raises(InvalidInput, match="'gcs'"):
        model(Config(), PlatformKind.GCS, Pose.planar(0.0, 0.0))


def test_current_carries_and_adds_to_own_speed() -> None:
    limits = SurfaceLimits(current_m_s=(0.3, -0.4))
    drifting = Surface(limits, Pose.planar(0.0, 0.0))
    for _ in range(100):
        drifting.step(Setpoint(1.0), 0.1)
    assert (drifting.pose().x_m, drifting.pose().y_m) == pytest.approx((3.0, -4.0))
    assert (drifting.pose().vx_m_s, drifting.pose().vy_m_s) == pytest.approx((0.3, -0.4))
    drifting.armed = True
    for _ in range(100):
        drifting.step(Setpoint(1.0), 0.1)
    assert (drifting.pose().vx_m_s, drifting.pose().vy_m_s) == pytest.approx((1.3, -0.4), abs=0.01)
