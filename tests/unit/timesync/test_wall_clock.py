"""Steps of the wall clock: detected, reported for a minute, and distinguished from a delayed process."""

import pytest

from swarmd.timesync.core.wall_clock import LATE_NS, SHOWN_NS, STEP_NS, WallClock

S = 1_000_000_000
YEAR_2026_NS = 1_790_000_000 * S


def looks(*readings: tuple[float, float]) -> list[float]:
    """Steps that readings of node clock and wall clock, in seconds since the start, report."""
    clock = WallClock()
    return [
        clock.on_look(round(node_s * S), YEAR_2026_NS + round(wall_s * S), round(node_s * S)).step_s
        for node_s, wall_s in readings
    ]


def test_clocks_that_run_alike_have_no_step() -> None:
    assert looks((1, 1), (2, 2.00002), (3, 3.1), (4, 4.2)) == [0, 0, 0, 0]


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0, 0.2, 31_536_000.0])
def test_step_is_reported_with_sign_for_minute(step_s: float) -> None:
    shown_s = SHOWN_NS / S
    found = looks(
        (1, 1), (2, 2 + step_s), (1 + shown_s, 1 + shown_s + step_s), (2 + shown_s, 2 + shown_s + step_s)
    )
    assert found == pytest.approx([0, step_s, step_s, 0])


def test_a_second_step_replaces_the_first_one() -> None:
    assert looks((1, 1), (2, -3598), (3, 3603)) == pytest.approx([0, -3600, 7200])


def test_interruption_between_readings_is_no_step() -> None:
    clock = WallClock()
    clock.on_look(S, YEAR_2026_NS + S, S)
    late_ns = 2 * S + 2 * STEP_NS
    assert late_ns - 2 * S > LATE_NS
    assert clock.on_look(2 * S, YEAR_2026_NS + 2 * S, late_ns).step_s == 0
    assert clock.on_look(3 * S, YEAR_2026_NS + 3 * S, 3 * S).step_s == 0
