"""The geofence: its settings and their errors, where a vehicle is to it, which targets it refuses."""

import math
from typing import Any

import pytest

from swarmd.mission.config import Config
from swarmd.mission.core.fence import Geofence, area_of, needs_origin, stop_m
from swarmd.mission.fence_config import FenceConfig
from swarmware.errors import ConfigError
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.model import config as files
from swarmware.types.fence import FenceLimit
from swarmware.types.vehicle import Pose

SQUARE = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))
BAY = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (0.0, 0.0), (-50.0, 50.0))
AREA, LOW, HIGH, NONE = FenceLimit.AREA, FenceLimit.MIN_HEIGHT, FenceLimit.MAX_HEIGHT, FenceLimit.NONE


def fence(origin: Origin | None = None, **settings: Any) -> Geofence:
    config = FenceConfig(**settings)
    return Geofence(config, area_of(config, None if origin is None else LocalMap(origin)))


def pose(x_m: float, y_m: float, z_m: float = 5.0, **velocity: float) -> Pose:
    return Pose(x_m, y_m, z_m, **velocity)


@pytest.mark.parametrize(
    ("text", "line", "error"),
    [
        ("", 1, "neither an area nor heights; expected one of polygon_m, polygon_deg, centre_m, centre_deg"),
        ("polygon_m = [[0, 0], [1, 0]]", 1, "key polygon_m: 2 corners; expected 3 at least"),
        (
            "polygon_m = [[0, 0], [9, 9], [9, 0], [0, 9]]",
            1,
            "key polygon_m: the edges from corner 1 to 2 and from corner 3 to 4 meet; expected a",
        ),
        (
            "polygon_deg = [[48, 8], [49, 9], [48, 9], [49, 8]]",
            1,
            "key polygon_deg: the edges from corner 1 to 2 and from corner 3 to 4 meet",
        ),
        ("polygon_m = [[0, 0], [9, 0], [9, 0], [0, 9]]", 1, "corners 2 and 3 are the same place"),
        ("polygon_m = [[0, 0], [9, 0], [0, 9], [0, 0]]", 1, "corners 4 and 1 are the same place"),
        ("polygon_m = [[0, 0], [9, 0], [nan, 9]]", 2, r"fence\.polygon_m\[2\]"),
        ("polygon_m = [[0, 0], [9, 0], [inf, 9]]", 2, r"fence\.polygon_m\[2\]"),
        ("polygon_m = [[0, 0], [9, 0], [9]]", 2, r"fence\.polygon_m\[2\]"),
        (
            "polygon_deg = [[91, 8], [49, 9], [48, 9]]",
            1,
            "corner 1: latitude 91; expected .latitude, longitude.",
        ),
        ("polygon_deg = [[9, 181], [49, 9], [48, 9]]", 2, r"fence\.polygon_deg\[0\]"),
        ("centre_deg = [95, 8]\nradius_m = 9", 1, "key centre_deg: latitude 95"),
        ("centre_m = [0, 0]", 1, "key radius_m: missing; expected centre and radius"),
        ("radius_m = 9", 1, "key centre_m or centre_deg: missing; expected centre and radius"),
        ("centre_m = [0, 0]\nradius_m = 0", 3, r"fence\.radius_m"),
        (
            "centre_m = [0, 0]\nradius_m = 9\npolygon_m = [[0, 0], [9, 0], [0, 9]]",
            1,
            "key centre_m: polygon_m is given too; expected one area",
        ),
        ("min_height_m = 9\nmax_height_m = 9", 1, "key min_height_m: 9 is not below max_height_m"),
        ("max_height_m = 9\nmargin_m = -1", 3, r"fence\.margin_m"),
        ("hight_m = 9", 2, "hight_m"),
    ],
)
def test_invalid_settings_are_refused_with_file_and_key(text: str, line: int, error: str) -> None:
    with pytest.raises(ConfigError, match=error) as caught:
        files.parse(f"[fence]\n{text}\n", Config, "mission.toml")
    assert caught.value.line == line
    assert "mission.toml: line" in str(caught.value)


def test_a_node_has_no_fence_by_default() -> None:
    assert files.parse("", Config, "mission.toml").fence is None
    found = files.parse("[fence]\nmax_height_m = 30\n", Config, "mission.toml").fence
    assert found == FenceConfig(max_height_m=30.0)


@pytest.mark.parametrize(
    ("settings", "place", "inside", "distance_m", "limit"),
    [
        ({"polygon_m": SQUARE}, pose(0, 0), True, 50.0, AREA),
        ({"polygon_m": SQUARE}, pose(48, 0), True, 2.0, AREA),
        ({"polygon_m": SQUARE}, pose(50, 0), True, 0.0, AREA),
        ({"polygon_m": SQUARE}, pose(53, 54), False, -5.0, AREA),
        ({"polygon_m": BAY}, pose(0, 30), False, -30 / math.sqrt(2), AREA),
        ({"centre_m": (10.0, 0.0), "radius_m": 30.0}, pose(10, 20), True, 10.0, AREA),
        ({"centre_m": (10.0, 0.0), "radius_m": 30.0}, pose(-25, 0), False, -5.0, AREA),
        ({"max_height_m": 20.0}, pose(999, 0, 19), True, 1.0, HIGH),
        ({"max_height_m": 20.0}, pose(0, 0, 21), False, -1.0, HIGH),
        ({"min_height_m": 3.0}, pose(0, 0, 10), True, 7.0, LOW),
        ({"min_height_m": 3.0}, pose(0, 0, 1), True, None, NONE),  # it climbs: it was not above it yet
        ({"polygon_m": SQUARE, "max_height_m": 20.0}, pose(45, 0, 18), True, 2.0, HIGH),
        ({"polygon_m": SQUARE, "max_height_m": 20.0}, pose(55, 0, 21), False, -5.0, AREA),
    ],
)
def test_the_nearest_limit_is_named_with_its_distance(
    settings: dict[str, Any], place: Pose, inside: bool, distance_m: float | None, limit: FenceLimit
) -> None:
    state = fence(**settings).state(place, landed=False, landing=False)
    assert (state.exists, state.inside, state.limit) == (True, inside, limit)
    assert state.distance_m == (None if distance_m is None else pytest.approx(distance_m))
    assert (state.min_height_m, state.max_height_m) == (
        settings.get("min_height_m"),
        settings.get("max_height_m"),
    )


@pytest.mark.parametrize(
    ("settings", "place", "leaving"),
    [
        ({"polygon_m": SQUARE}, pose(49, 0), False),
        ({"polygon_m": SQUARE}, pose(51, 0), True),
        # at 5 m/s: 4 m until it brakes, 6.25 m of braking
        ({"polygon_m": SQUARE}, pose(40, 0, vx_m_s=5.0), True),
        ({"polygon_m": SQUARE}, pose(39, 0, vx_m_s=5.0), False),
        ({"polygon_m": SQUARE}, pose(49, 0, vy_m_s=5.0), False),  # along the boundary
        ({"polygon_m": SQUARE}, pose(49, 0, vx_m_s=-5.0), False),  # away from it
        ({"polygon_m": SQUARE, "margin_m": 5.0}, pose(46, 0), True),
        ({"polygon_m": SQUARE, "margin_m": 5.0}, pose(34, 0, vx_m_s=5.0), False),
        ({"polygon_m": SQUARE, "margin_m": 5.0}, pose(35, 0, vx_m_s=5.0), True),
        # over the bay to a place that is inside again
        ({"polygon_m": BAY}, pose(-6, 7, -0.5, vx_m_s=4.0, vy_m_s=0.0), True),
        ({"centre_m": (0.0, 0.0), "radius_m": 50.0}, pose(42, 0, vx_m_s=5.0), True),
        ({"centre_m": (0.0, 0.0), "radius_m": 50.0}, pose(42, 0, vx_m_s=-5.0), False),
        ({"max_height_m": 20.0}, pose(0, 0, 19, vz_m_s=2.0), True),
        ({"max_height_m": 20.0}, pose(0, 0, 17, vz_m_s=2.0), False),
        ({"max_height_m": 20.0}, pose(0, 0, 19, vz_m_s=-2.0), False),
        ({"min_height_m": 3.0}, pose(0, 0, 4, vz_m_s=-2.0), True),
        ({"min_height_m": 3.0}, pose(0, 0, 4, vz_m_s=0.0), False),
    ],
)
def test_vehicle_leaves_when_it_cannot_stop_before_limit(
    settings: dict[str, Any], place: Pose, leaving: bool
) -> None:
    assert fence(**settings).state(place, landed=False, landing=False).leaving is leaving


def test_faster_vehicle_needs_disproportionate_stopping_distance() -> None:
    assert (stop_m(0.0), stop_m(2.0), stop_m(10.0)) == pytest.approx((0.0, 2.6, 33.0))


def test_lowest_height_binds_from_climb_to_landing() -> None:
    found = fence(min_height_m=3.0, margin_m=1.0)
    flight = [
        (0.0, True, False, NONE),
        (2.0, False, False, NONE),  # it climbs
        (3.5, False, False, NONE),  # within the margin
        (6.0, False, False, LOW),
        (2.0, False, False, LOW),  # it sank
        (2.0, False, True, NONE),  # it lands
        (0.0, True, False, NONE),
        (2.0, False, False, NONE),
    ]
    seen = [
        found.state(pose(0, 0, z_m), landed=landed, landing=landing).limit
        for z_m, landed, landing, _ in flight
    ]
    assert seen == [limit for *_, limit in flight]


@pytest.mark.parametrize(
    ("settings", "place", "z_m", "why"),
    [
        ({"polygon_m": SQUARE}, (40.0, 0.0), 5.0, ""),
        ({"polygon_m": SQUARE}, (52.0, 0.0), 5.0, "2.0 m outside the boundary of the fence"),
        ({"polygon_m": SQUARE}, (52.0, 0.0), None, "2.0 m outside the boundary of the fence"),
        ({"polygon_m": BAY}, (0.0, 10.0), 5.0, "7.1 m outside the boundary of the fence"),
        (
            {"polygon_m": SQUARE, "margin_m": 3.0},
            (48.0, 0.0),
            5.0,
            "2.0 m from the boundary of the fence; expected 3 m (margin_m)",
        ),
        ({"max_height_m": 20.0}, None, 25.0, "5.0 m outside the greatest height (20 m) of the fence"),
        ({"max_height_m": 20.0}, (0.0, 0.0), None, ""),  # it keeps its height
        ({"min_height_m": 3.0}, None, 1.0, "2.0 m outside the lowest height (3 m) of the fence"),
        (
            {"polygon_m": SQUARE, "max_height_m": 20.0},
            (60.0, 0.0),
            30.0,
            "10.0 m outside the greatest height (20 m) of the fence,"
            " 10.0 m outside the boundary of the fence",
        ),
        ({"polygon_m": SQUARE, "max_height_m": 20.0}, None, 5.0, ""),
    ],
)
def test_a_target_outside_is_refused_with_its_limit(
    settings: dict[str, Any], place: tuple[float, float] | None, z_m: float | None, why: str
) -> None:
    assert fence(**settings).why_not(place, z_m) == why


ACROSS = Origin(lat_deg=-17.0, lon_deg=179.999)
"""The antimeridian is 106 m to the east."""


def test_degrees_are_placed_in_map_also_across_antimeridian() -> None:
    local = LocalMap(ACROSS)
    corners = tuple(
        local.to_wgs84(x_m, y_m, 0.0)[:2] for x_m, y_m in ((-200, -200), (200, -200), (200, 200), (-200, 200))
    )
    assert {math.copysign(1, lon) for _, lon in corners} == {1.0, -1.0}
    settings = {"polygon_deg": corners}
    assert needs_origin(FenceConfig(**settings))  # type: ignore[arg-type]  # a dict of one key
    found = fence(ACROSS, **settings)
    for x_m, y_m, inside, distance_m in ((150, 0, True, 50.0), (210, 0, False, -10.0), (0, 0, True, 200.0)):
        state = found.state(pose(x_m, y_m), landed=False, landing=False)
        assert state.inside is inside
        assert state.distance_m == pytest.approx(distance_m, abs=0.05)


def test_circle_in_degrees_is_that_in_map() -> None:
    origin = Origin(lat_deg=48.0, lon_deg=11.0)
    lat_deg, lon_deg, _ = LocalMap(origin).to_wgs84(30.0, 40.0, 0.0)
    found = fence(origin, centre_deg=(lat_deg, lon_deg), radius_m=60.0)
    state = found.state(pose(0, 0), landed=False, landing=False)
    assert state.distance_m == pytest.approx(10.0, abs=0.01)
    assert not needs_origin(FenceConfig(centre_m=(0.0, 0.0), radius_m=60.0))
