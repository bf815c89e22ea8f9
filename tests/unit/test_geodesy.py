"""The local map against the exact way over earth-centred coordinates."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import ConfigError
from swarmware.geometry.geodesy import FLATTENING, SEMI_MAJOR_M, LocalMap, Origin
from swarmware.model.config import parse

E2 = FLATTENING * (2 - FLATTENING)


def ecef(lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    n = SEMI_MAJOR_M / math.sqrt(1 - E2 * math.sin(lat) ** 2)
    return (
        (n + alt_m) * math.cos(lat) * math.cos(lon),
        (n + alt_m) * math.cos(lat) * math.sin(lon),
        (n * (1 - E2) + alt_m) * math.sin(lat),
    )


def exact_enu(origin: Origin, lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
    x0, y0, z0 = ecef(origin.lat_deg, origin.lon_deg, origin.alt_ellipsoid_m)
    x, y, z = ecef(lat_deg, lon_deg, alt_m)
    dx, dy, dz = x - x0, y - y0, z - z0
    lat, lon = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
    east = -math.sin(lon) * dx + math.cos(lon) * dy
    north = -math.sin(lat) * (math.cos(lon) * dx + math.sin(lon) * dy) + math.cos(lat) * dz
    up = math.cos(lat) * (math.cos(lon) * dx + math.sin(lon) * dy) + math.sin(lat) * dz
    return east, north, up


@pytest.mark.parametrize(("reach_m", "error_m"), [(100.0, 0.001), (1_000.0, 0.01), (10_000.0, 1.0)])
@pytest.mark.parametrize("lat_deg", [-60.0, -33.0, 0.0, 48.0, 65.0])
def test_local_map_is_as_exact_as_it_says(lat_deg: float, reach_m: float, error_m: float) -> None:
    origin = Origin(lat_deg=lat_deg, lon_deg=11.0, alt_ellipsoid_m=520.0)
    local = LocalMap(origin)
    for turn in range(16):
        east, north = reach_m * math.cos(turn * math.pi / 8), reach_m * math.sin(turn * math.pi / 8)
        fix = local.to_wgs84(east, north, 50.0)
        assert math.dist(exact_enu(origin, *fix), (east, north, 50.0)) < error_m
        assert math.dist(local.to_local(*fix), (east, north, 50.0)) < error_m


@given(
    st.floats(-80, 80), st.floats(-180, 180), st.floats(-500, 500), st.floats(-500, 500), st.floats(0, 200)
)
def test_there_and_back_is_the_same_place(lat: float, lon: float, x: float, y: float, z: float) -> None:
    local = LocalMap(Origin(lat_deg=lat, lon_deg=lon))
    assert math.dist(local.to_local(*local.to_wgs84(x, y, z)), (x, y, z)) < 0.002


def test_the_date_line_is_no_border() -> None:
    local = LocalMap(Origin(lat_deg=10.0, lon_deg=179.9999))
    lat, lon, alt = local.to_wgs84(100.0, 0.0, 0.0)
    assert lon < -179.0
    assert local.to_local(lat, lon, alt)[0] == pytest.approx(100.0, abs=1e-3)


def test_a_pole_is_no_origin() -> None:
    with pytest.raises(ConfigError, match="expected lat_deg within"):
        parse("lat_deg = 90.0", Origin, "world.toml")
