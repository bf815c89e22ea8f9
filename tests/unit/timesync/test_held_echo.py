"""Echoes are held until there is room for them: seconds, in which the clocks drift apart."""

import pytest

from swarmd.timesync.core.peer import ClockEstimator, Exchange
from swarmware.model.clock import Clock

DELAY_NS = 30_000


@pytest.mark.parametrize("drift_ppm", [-95.0, -60.0, 60.0, 95.0])
def test_old_echo_still_bounds_fast_clock(drift_ppm: float) -> None:
    here, there = Clock(0.0, 0.0), Clock(3.0, drift_ppm)
    peer = ClockEstimator("b", "main", 1, 1, window_s=60.0, pause_s=1.0, conv_epoch=0)
    for tick in range(400):
        sent_ns = 10**12 + tick * 100_000_000
        received_ns = sent_ns + DELAY_NS
        least_ns = there.from_mono_ns(sent_ns) - here.from_mono_ns(received_ns)
        echo_ns, most_ns = 0, None
        if tick % 20 == 19:
            echo_ns = sent_ns - 2_000_000_000
            most_ns = there.from_mono_ns(echo_ns + DELAY_NS) - here.from_mono_ns(echo_ns)
        peer.on_exchange(Exchange(received_ns, least_ns, echo_ns, most_ns))
        due_ns = peer.due_ns()
        if due_ns is not None and due_ns <= received_ns:
            peer.solve(received_ns)
    assert peer.conversion is not None
    assert peer.conversion.skew * 1e6 == pytest.approx(drift_ppm, abs=2.0)
    error_ns = peer.conversion.to_remote(received_ns) - there.from_mono_ns(received_ns)
    assert abs(error_ns) <= peer.conversion.bound_at_ns(received_ns)
    assert peer.steps == 0


@pytest.mark.parametrize("held_ms", [0, 100, 500])
@pytest.mark.parametrize("drift_ppm", [-95.0, -40.0, 0.0, 40.0, 95.0])
def test_round_trip_is_never_shortened_by_hold(drift_ppm: float, held_ms: int) -> None:
    here, there = Clock(0.0, 0.0), Clock(-3.0, drift_ppm)
    peer = ClockEstimator("b", "main", 1, 1, window_s=60.0, pause_s=1.0, conv_epoch=0)
    for tick in range(600):
        sent_ns = 10**12 + tick * 100_000_000
        received_ns = sent_ns + DELAY_NS
        echo_ns = sent_ns - held_ms * 1_000_000 - DELAY_NS
        peer.on_exchange(
            Exchange(
                received_ns,
                there.from_mono_ns(sent_ns) - here.from_mono_ns(received_ns),
                echo_ns,
                there.from_mono_ns(echo_ns + DELAY_NS) - here.from_mono_ns(echo_ns),
            )
        )
        due_ns = peer.due_ns()
        if due_ns is not None and due_ns <= received_ns:
            peer.solve(received_ns)
        if peer.conversion is not None and peer.conversion.rtt_ns:
            assert peer.conversion.rtt_ns >= 2 * DELAY_NS - 1_000, "the resolution of the stamps"
            assert peer.conversion.plausible()
    assert peer.conversion is not None
    assert 2 * DELAY_NS - 1_000 <= peer.conversion.rtt_ns <= 2 * DELAY_NS + 10_000


def test_smallest_round_trip_is_of_last_two_windows() -> None:
    peer = ClockEstimator("b", "main", 1, 1, window_s=10.0, pause_s=1.0, conv_epoch=0)
    found = []
    for tick in range(400):
        delay_ns = DELAY_NS if tick < 100 else 5 * DELAY_NS
        sent_ns = 10**12 + tick * 100_000_000
        echo_ns = sent_ns - 2 * delay_ns
        peer.on_exchange(Exchange(sent_ns + delay_ns, -delay_ns, echo_ns, delay_ns))
        due_ns = peer.due_ns()
        if due_ns is not None and due_ns <= sent_ns + delay_ns:
            peer.solve(sent_ns + delay_ns)
        if peer.conversion is not None:
            found.append(peer.conversion.rtt_ns)
    assert found[90] < 2 * DELAY_NS + 10_000
    assert found[-1] > 9 * DELAY_NS
