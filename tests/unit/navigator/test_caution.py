"""Speed towards platforms whose positions are old: a table of situations, and an approach in steps."""

import math
from typing import Any

import msgspec
import pytest

from swarmd.navigator.core.caution import FRESH_S, MARGIN_M, cautious
from swarmd.navigator.core.target import PLATFORM_RADIUS_M, MovingObstacle, Surroundings
from swarmware.types.vehicle import Pose, Setpoint

HERE = Pose.planar(0.0, 0.0, 8.0)
BODIES_M = 2 * PLATFORM_RADIUS_M + MARGIN_M
AHEAD = Setpoint(2.0, 0.0, 0.5, 0.4)


def at(x_m: float, y_m: float = 0.0, age_s: float = 2.0, **changes: Any) -> Surroundings:
    other = MovingObstacle(x_m, y_m, 8.0, 0.0, 0.0, 0.0, age_s=age_s)
    return Surroundings(neighbours=(msgspec.structs.replace(other, **changes),))


def speed(around: Surroundings, delay_s: float = 0.0, setpoint: Setpoint = AHEAD, pose: Pose = HERE) -> float:
    found = cautious(setpoint, pose, msgspec.structs.replace(around, delay_s=delay_s), flies=True)
    return math.hypot(found.vx_m_s, found.vy_m_s)


@pytest.mark.parametrize(
    ("around", "delay_s", "expected_m_s"),
    [
        (Surroundings(), 9.0, 2.0),
        (at(3.0, age_s=FRESH_S), 0.0, 2.0),
        (at(3.0), 0.0, (3.0 - BODIES_M) / 2.0),
        (at(3.0, age_s=0.5), 1.5, (3.0 - BODIES_M) / 2.0),
        (at(30.0), 0.0, 2.0),
        (at(-3.0), 0.0, 2.0),
        (at(0.0, 3.0), 0.0, 2.0),
        (at(0.5), 0.0, 0.0),
        (at(0.0), 0.0, 2.0),
        (at(3.0, z_m=10.0), 0.0, 2.0),
        (at(5.0, vx_m_s=-1.0), 0.0, (5.0 - BODIES_M - 2.0) / 2.0),
        (at(5.0, vx_m_s=1.0), 0.0, 2.0),
    ],
)
def test_vehicle_covers_at_most_gap_while_blind(
    around: Surroundings, delay_s: float, expected_m_s: float
) -> None:
    assert speed(around, delay_s) == pytest.approx(expected_m_s)


def test_velocity_is_in_map_not_body() -> None:
    left = Pose.planar(0.0, 0.0, 8.0, math.pi / 2)
    assert speed(at(0.0, 3.0), pose=left) == pytest.approx((3.0 - BODIES_M) / 2.0)
    assert speed(at(3.0), pose=left) == 2.0
    assert speed(at(3.0), setpoint=Setpoint(0.0, -2.0), pose=left) == pytest.approx((3.0 - BODIES_M) / 2.0)


def test_the_nearest_in_the_way_decides() -> None:
    both = Surroundings(neighbours=at(4.0).neighbours + at(3.0).neighbours + at(-1.5).neighbours)
    assert speed(both) == speed(at(3.0))


def test_ground_vehicle_keeps_arc_flyer_its_climb() -> None:
    drives = cautious(AHEAD, HERE, at(3.0), flies=False)
    assert drives.wz_rad_s / drives.vx_m_s == pytest.approx(AHEAD.wz_rad_s / AHEAD.vx_m_s)
    flies = cautious(AHEAD, HERE, at(3.0), flies=True)
    assert (flies.wz_rad_s, flies.vz_m_s) == (AHEAD.wz_rad_s, AHEAD.vz_m_s)


def test_two_approaching_blindly_do_not_touch() -> None:
    blind_s, places = 2.0, [-4.0, 4.0]
    seen, speeds = list(places), [0.0, 0.0]
    for _ in range(20):
        before = list(places)
        for one, other, way in ((0, 1, 1.0), (1, 0, -1.0)):
            # each knows where the other was a whole turn ago, and how fast
            around = at(seen[other], age_s=blind_s, vx_m_s=speeds[other])
            pose = Pose.planar(places[one], 0.0, 8.0)
            speeds[one] = cautious(Setpoint(2.0 * way), pose, around, flies=True).vx_m_s
        places = [place + speed_m_s * blind_s / 2 for place, speed_m_s in zip(places, speeds, strict=True)]
        seen = before
        assert places[1] - places[0] > 2 * PLATFORM_RADIUS_M
