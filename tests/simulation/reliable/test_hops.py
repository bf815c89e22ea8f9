"""Messages over several lossy hops, with their acknowledgements, in virtual time."""

import pytest
from tests.simulation.reliable.chain import Chain
from tests.simulation.seeds import cases

RATE_MS = 200
LASTS_S = 20


@pytest.mark.parametrize(("hops", "loss", "p99_ms"), cases([(3, 0.3, 500)], [(1, 0.3, 300), (3, 0.4, 900)]))
def test_messages_over_lossy_hops_are_confirmed_in_time(hops: int, loss: float, p99_ms: float) -> None:
    times_ms: list[float] = []
    for seed in range(2):
        chain = Chain(hops, seed, loss)
        chain.run(LASTS_S, RATE_MS, 200)
        assert all(outcome.delivered for _, outcome in chain.told)
        times_ms += [time_ms for time_ms, _ in chain.told]
    times_ms.sort()
    assert len(times_ms) == 2 * LASTS_S * 1000 // RATE_MS
    assert times_ms[int(0.99 * len(times_ms))] < p99_ms


def test_message_without_loss_takes_one_round_trip() -> None:
    chain = Chain(3, 1, 0.0)
    chain.run(4, RATE_MS, 200)
    assert [round(time_ms) for time_ms, _ in chain.told] == [60] * 20
    assert set(chain.arrived.values()) == {1}
    assert chain.repeated_bytes == 0
