"""A function that is frozen at any age and extrapolated: its bound stays true."""

import pytest
from tests.simulation.timesync.clocks import Delay, asymmetric, lan, simulate, uniform, wifi

FREEZE_S = (0.5, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 40, 70)
AHEAD_S = (0.0, 0.5, 1, 3, 10, 30, 100, 300, 1000, 3600)
SEEDS = 6


@pytest.mark.parametrize("delay", [lan, asymmetric, uniform, wifi], ids=lambda delay: delay.__name__)
@pytest.mark.parametrize(
    ("period_s", "echo_s", "swing"),
    [
        (0.1, 0.0, (0.0, 60.0)),
        (0.1, 2.1, (2e-6, 60.0)),
        (0.1, 0.0, (5e-6, 120.0)),
        (0.5, 2.1, (0.0, 60.0)),
        (0.25, 5.0, (0.0, 60.0)),
    ],
    ids=["10 Hz", "16 in a cell, 2 ppm in 60 s", "5 ppm in 120 s", "2 Hz", "rare echoes"],
)
def test_true_offset_stays_inside_bound_at_any_age(
    delay: Delay, period_s: float, echo_s: float, swing: tuple[float, float]
) -> None:
    outside: list[str] = []
    judged = 0
    for seed in range(SEEDS):
        for freeze_s in FREEZE_S:
            run = simulate(delay, seed, length_s=freeze_s, swing=swing, period_s=period_s, echo_s=echo_s)
            function = run.peer.conversion
            if function is None:
                continue
            for ahead_s in AHEAD_S:
                for clock in (run.here, run.there):
                    clock.wander_to(freeze_s + ahead_s)
                now_ns = run.here.read_ns(freeze_s + ahead_s)
                error_ns = abs(function.to_remote(now_ns) - run.there.read_ns(freeze_s + ahead_s))
                judged += 1
                if error_ns > function.bound_at_ns(now_ns):
                    outside.append(f"seed {seed}: {ahead_s} s after {freeze_s} s")
    assert judged > 0.9 * SEEDS * len(FREEZE_S) * len(AHEAD_S)
    assert len(outside) <= 0.001 * judged, outside
