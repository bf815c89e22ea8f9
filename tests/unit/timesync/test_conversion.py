"""Conversion functions: both ways, composed, inverted, compared."""

import contextlib

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.types.registry import decode, encode
from swarmware.types.time import Conversion, Order, TimeFunctions, compare


def conversion(**changes: object) -> Conversion:
    plain = Conversion(
        platform="uav2",
        unit="main",
        hardware=2,
        boot_id=7,
        offset_ns=5_000_000_000,
        skew=40e-6,
        t0_ns=1_000_000_000_000,
        bound_ns=80_000,
        sigma_ns=2_000,
        skew_bound=1e-6,
        conv_epoch=0,
        samples=100,
    )
    return msgspec.structs.replace(plain, **changes)


@given(
    offset_ns=st.integers(-(10**12), 10**12),
    skew=st.floats(-200e-6, 200e-6),
    away_ns=st.integers(-3600 * 10**9, 3600 * 10**9),
)
def test_there_and_back_is_the_same_instant(offset_ns: int, skew: float, away_ns: int) -> None:
    function = conversion(offset_ns=offset_ns, skew=skew)
    local_ns = function.t0_ns + away_ns
    assert abs(function.to_local(function.to_remote(local_ns)) - local_ns) <= 1


@given(skew=st.floats(-200e-6, 200e-6), away_ns=st.integers(-(10**11), 10**11))
def test_inverse_is_other_side_of_same_relation(skew: float, away_ns: int) -> None:
    function = conversion(skew=skew)
    inverse = function.inverse("uav1", "main", 1, 3)
    local_ns = function.t0_ns + away_ns
    assert abs(inverse.to_remote(function.to_remote(local_ns)) - local_ns) <= 2
    assert (inverse.platform, inverse.hardware, inverse.boot_id) == ("uav1", 1, 3)


def test_composition_converts_over_links_adding_bounds() -> None:
    first = conversion()
    second = conversion(
        platform="uav3", hardware=3, offset_ns=-2_000_000_000, t0_ns=1_004_000_000_000, skew=-10e-6
    )
    both = first.then(second, "uav2")
    at_ns = both.t0_ns + 3_000_000_000
    assert abs(both.to_remote(at_ns) - second.to_remote(first.to_remote(at_ns))) <= 5
    assert both.bound_at_ns(at_ns) >= first.bound_ns + second.bound_ns
    assert (both.platform, both.hops, both.via) == ("uav3", 2, "uav2")


def test_composition_is_as_old_as_its_older_link() -> None:
    fresh = conversion()
    stale = conversion(platform="uav3", hardware=3, t0_ns=fresh.to_remote(fresh.t0_ns) - 30_000_000_000)
    assert fresh.then(stale, "uav2").age_s(fresh.t0_ns) == pytest.approx(30.0, abs=0.01)


def test_bound_grows_with_distance_from_last_exchange() -> None:
    function = conversion()
    bounds = [function.bound_at_ns(function.t0_ns + away_s * 10**9) for away_s in (0, 1, 10, 100)]
    assert bounds[0] == function.bound_ns
    assert bounds == sorted(set(bounds))


def test_stamps_whose_bounds_overlap_cannot_be_ordered() -> None:
    function = conversion(skew=0.0)
    theirs_ns = function.to_remote(function.t0_ns)
    assert compare(theirs_ns, function, function.t0_ns + 1_000_000, None) is Order.BEFORE
    assert compare(theirs_ns, function, function.t0_ns - 1_000_000, None) is Order.AFTER
    assert compare(theirs_ns, function, function.t0_ns + 50_000, None) is Order.UNDECIDED


def test_stamps_of_one_clock_are_always_ordered() -> None:
    function = conversion()
    assert compare(1_000, function, 1_001, function) is Order.BEFORE
    assert compare(1_000, None, 1_001, None) is Order.BEFORE
    assert compare(1_000, function, 1_001, conversion(boot_id=8)) is Order.UNDECIDED


def test_a_third_party_orders_events_of_two_others() -> None:
    uav2 = conversion(skew=0.0)
    uav3 = conversion(platform="uav3", hardware=3, offset_ns=-7_000_000_000, skew=0.0)
    at_ns = uav2.t0_ns
    first, second = uav2.to_remote(at_ns), uav3.to_remote(at_ns + 1_000_000)
    assert compare(first, uav2, second, uav3) is Order.BEFORE
    assert compare(second, uav3, first, uav2) is Order.AFTER


def test_list_finds_unit_and_crosses_wire() -> None:
    functions = TimeFunctions("uav1", "main", 3, 5, (conversion(), conversion(platform="uav3", hardware=3)))
    again = decode(TimeFunctions, encode(functions))
    assert again == functions
    assert again.of("uav3") == functions.functions[1]
    assert again.of("uav9") is None
    assert again.of("uav3", "fc1") is None


@given(st.binary(max_size=200))
def test_foreign_bytes_are_functions_or_a_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        decode(TimeFunctions, data)
