"""Ticks at absolute instants: misses counted, never made up for."""

import asyncio
import math

import pytest

from swarmware.errors import InvalidInput
from swarmware.model.clock import Clock
from swarmware.module.ticker import Lateness, Ticker

PERIOD_NS = 1_000_000


class Hand(Clock):
    """A clock that a test sets; a look at it takes no time."""

    __slots__ = ("at_ns",)

    def __init__(self) -> None:
        super().__init__()
        self.at_ns = 0

    def now_ns(self) -> int:
        return self.at_ns


@pytest.mark.parametrize(
    ("instants_ms", "ticks", "missed"),
    [
        ([1.0, 2.0, 3.0], [1, 2, 3], 0),
        ([1.2, 2.9, 3.0], [1, 2, 3], 0),
        ([1.0, 6.5, 7.0], [1, 6, 7], 4),
        ([9.99, 10.0, 12.5], [9, 10, 12], 9),
    ],
)
def test_late_ticker_continues_at_next_instant(
    instants_ms: list[float], ticks: list[int], missed: int
) -> None:
    async def run() -> None:
        clock, lateness = Hand(), Lateness()
        ticker = Ticker(clock, PERIOD_NS / 1e9, lateness)
        seen = []
        for instant_ms in instants_ms:
            clock.at_ns = round(instant_ms * PERIOD_NS)
            seen.append(await anext(ticker))
            assert ticker.late_ns == clock.at_ns - seen[-1] * PERIOD_NS
        assert seen == ticks
        assert ticker.missed == missed
        assert 0 <= lateness.take_s() < 0.001
        assert lateness.take_s() == 0

    asyncio.run(run())


@pytest.mark.parametrize("period_s", [0.0, -1.0, math.nan, math.inf, -math.inf, 1e-12, 1e300])
def test_a_period_must_be_positive_and_countable(period_s: float) -> None:
    with pytest.raises(InvalidInput, match="more than 0"):
        Ticker(Hand(), period_s)


def test_new_period_starts_at_its_multiples() -> None:
    async def run() -> None:
        clock, lateness = Hand(), Lateness()
        ticker = Ticker(clock, 0.010, lateness)
        clock.at_ns = 30_000_000
        assert await anext(ticker) == 3
        ticker.retime(0.010)
        clock.at_ns = 40_000_000
        assert await anext(ticker) == 4
        ticker.retime(0.004)
        assert ticker.period_s == 0.004
        clock.at_ns = 44_000_000
        assert await anext(ticker) == 1, "40 ms is the last multiple of 4 ms, the next one is 44 ms"
        with pytest.raises(InvalidInput):
            ticker.retime(0.0)

    asyncio.run(run())


def test_worst_lateness_is_kept_until_it_is_taken() -> None:
    lateness = Lateness()
    for late_ns in (5, 9_000_000, 3):
        lateness.note(late_ns)
    assert lateness.take_s() == 0.009
    lateness.note(1_000_000)
    assert lateness.take_s() == 0.001
