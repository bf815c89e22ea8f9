"""Delays of an input are reported once a second, each value once."""

from swarmd.navigator.core.input_delay import VALUES_MAX, DelayMeter
from swarmware.types.placement import InputDelays

MS = 1_000_000


def test_a_second_of_delays_makes_a_report() -> None:
    meter = DelayMeter()
    assert meter.take(0) is None, "there was no value"
    for index in range(20):
        meter.on_value(index * 50 * MS, (index * 50 + 4) * MS)
        assert meter.take((index * 50 + 4) * MS) is None
    meter.on_value(None, 1_000 * MS)
    meter.on_value(996 * MS, 1_010 * MS)
    assert meter.take(1_010 * MS) == InputDelays(4.48, 14.0, (4.0,) * 20 + (14.0,))
    assert meter.take(2_500 * MS) is None, "no value since then"


def test_a_fast_input_is_bounded() -> None:
    meter = DelayMeter()
    for index in range(2 * VALUES_MAX):
        meter.on_value(index, index + MS)
    found = meter.take(1_100 * MS)
    assert found is not None
    assert len(found.delays_ms) == VALUES_MAX
