"""The node's clock: monotonic, with a known error in the lab."""

from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.clock import Clock

MONO = st.integers(0, 10**17)


@given(MONO, st.floats(-3600, 3600), st.floats(-500, 500))
def test_stamps_convert_back_to_instant_they_were_taken(
    mono_ns: int, offset_s: float, drift_ppm: float
) -> None:
    clock = Clock(offset_s, drift_ppm)
    assert abs(clock.to_mono_ns(clock.from_mono_ns(mono_ns)) - mono_ns) <= 1


def test_offset_and_drift_are_what_was_asked_for() -> None:
    clock = Clock(offset_s=2.5, drift_ppm=50)
    assert clock.from_mono_ns(0) == 2_500_000_000
    assert clock.from_mono_ns(10**9) - clock.from_mono_ns(0) == 10**9 + 50_000


def test_a_clock_never_goes_back() -> None:
    clock = Clock(offset_s=-5, drift_ppm=-50)
    readings = [clock.now_ns() for _ in range(1000)]
    assert readings == sorted(readings)
