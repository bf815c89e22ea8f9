"""Ticks at absolute instants: misses counted, never made up for."""

import asyncio

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
def test_a_late_ticker_goes_on_at_the_next_instant(
    instants_ms: list[float], ticks: list[int], missed: int
) -> None:
    async def run() -> None:
        clock, lateness = Hand(), Lateness()
        ticker = Ticker(clock, PERIOD_NS / 1e9, lateness)
        seen = []
        for instant_ms in instants_ms:
            clock.at_ns = round(instant_ms * PERIOD_NS)
            seen.append(await anext(ticker))
        assert seen == ticks
        assert ticker.missed == missed
        assert 0 <= lateness.take_s() < 0.001
        assert lateness.take_s() == 0

    asyncio.run(run())


def test_a_period_must_be_positive() -> None:
    with pytest.raises(InvalidInput, match="more than 0"):
        Ticker(Hand(), 0.0)
