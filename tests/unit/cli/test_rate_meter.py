"""Rates from the counters and stamps of values: what was written is more than what arrives."""

import pytest

from swarmctl.resources.rate_meter import Observation, RateMeter

MS = 1_000_000


def meter(
    *, count: int, written_every_ms: int, arrives_each: int = 1, window_s: float | None = None
) -> RateMeter:
    found = RateMeter(window_s)
    for number in range(0, count * arrives_each, arrives_each):
        stamp_ns = 7 + number * written_every_ms * MS
        found.add(Observation(number + 1, stamp_ns, stamp_ns + 1000 + 5 * MS, 10, 0.005))
    return found


def test_halved_rate_of_20_hz_board_is_shown() -> None:
    found = meter(count=21, written_every_ms=50, arrives_each=2)
    assert found.written_hz == pytest.approx(20.0)
    assert found.here_hz == pytest.approx(10.0)
    assert found.thinned
    assert not meter(count=21, written_every_ms=50).thinned


def test_intervals_sizes_and_delays_have_their_distribution() -> None:
    found = meter(count=5, written_every_ms=100)
    found.add(Observation(6, 700 * MS, 700 * MS, 40, None))
    assert found.intervals_s is not None
    assert found.intervals_s.min == pytest.approx(0.1)
    assert found.intervals_s.max == pytest.approx(0.295, abs=1e-3)
    assert found.intervals_s.std == pytest.approx(0.078, abs=1e-3)
    assert found.sizes_bytes is not None
    assert (found.sizes_bytes.min, found.sizes_bytes.mean, found.sizes_bytes.max) == (10, 15, 40)
    assert found.bytes_per_s == pytest.approx(80 / 0.695, rel=1e-3)
    assert found.delays_s is not None
    assert (found.delays_s.mean, found.delays_s.std) == (0.005, 0.0)


def test_single_value_has_no_rate_none_nothing() -> None:
    none = RateMeter()
    assert (none.here_hz, none.intervals_s, none.span_s) == (None, None, 0)
    one = meter(count=1, written_every_ms=10)
    assert (one.written_hz, one.here_hz, one.bytes_per_s, one.intervals_s) == (None, None, None, None)


def test_only_window_counts_and_owners_restart_resets() -> None:
    found = meter(count=100, written_every_ms=10, window_s=0.1)
    assert len(found) == 11
    found.add(Observation(1, 5, 2000 * MS))
    assert (len(found), found.written_hz) == (1, None)


def test_values_numbered_on_arrival_await_owners_counter() -> None:
    found = RateMeter(numbered=False)
    for number in range(10):
        found.add(Observation(number + 1, number * 100 * MS, number * 100 * MS))
    assert (found.written_hz, found.thinned) == (None, False)
    found.counted_hz = 20.0
    assert found.written_hz == 20.0
    assert found.thinned
