"""Periodic work of one process: done together at the instants of the node's clock, stage by stage."""

import asyncio

import pytest
from tests.unit.runtime.virtual_loop import MS_NS, VirtualClock, VirtualLoop, run

from swarmware.module.ticker import Ticker
from swarmware.runtime.instant import LATE_NS, until


@pytest.mark.parametrize(("offset_s", "drift_ppm"), [(0.0, 0.0), (-417.3, 38.0), (12.0004999, -50.0)])
def test_tasks_of_one_instant_wake_together(offset_s: float, drift_ppm: float) -> None:
    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop, offset_s, drift_ppm)
        instant_ns = clock.now_ns() + 100_400_000
        woken: list[int] = []

        async def wait() -> None:
            await until(clock, instant_ns)
            woken.append(clock.now_ns())

        async with asyncio.TaskGroup() as group:
            for _ in range(40):
                group.create_task(wait())
                await asyncio.sleep(0)
                clock.spend(1_370_000)
        assert len(set(woken)) == 1
        assert 0 <= woken[0] - instant_ns < 2 * MS_NS

    assert len(run(main).virtual.wakes) == 1


def test_tickers_wake_only_at_multiples_of_periods() -> None:
    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop, 3.25)
        counts: dict[float, int] = {}

        async def tick(period_s: float, begin_ms: int) -> None:
            await asyncio.sleep(begin_ms / 1000)
            async for _ in Ticker(clock, period_s):
                assert clock.now_ns() % round(period_s * 1e9) == 0
                counts[period_s] = counts.get(period_s, 0) + 1
                if clock.now_ns() >= 6_250_000_000:
                    return

        async with asyncio.TaskGroup() as group:
            for begin_ms, period_s in enumerate((0.04, 0.05, 0.1, 1.0)):
                group.create_task(tick(period_s, begin_ms))
        assert {period_s: round(count * period_s, 1) for period_s, count in counts.items()} == {
            0.04: 3.0,
            0.05: 3.0,
            0.1: 3.1,
            1.0: 4.0,
        }

    begins = 3
    # in each 200 ms there are 8 instants of 40 and 50 ms; separate tickers would wake it 56 times a second
    assert len(run(main).virtual.wakes) <= 3 * 40 + begins + 8


def test_higher_stage_follows_lower_at_shared_instant() -> None:
    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop)
        order: list[tuple[int, int]] = []

        async def tick(stage: int, period_s: float) -> None:
            async for _ in Ticker(clock, period_s, stage=stage):
                order.append((clock.now_ns(), stage))
                if clock.now_ns() >= 2_000_000_000:
                    return

        async with asyncio.TaskGroup() as group:
            for stage, period_s in ((2, 0.05), (1, 0.1), (1, 0.04), (0, 0.04), (1, 1.0)):
                group.create_task(tick(stage, period_s))
        assert order == sorted(order)
        assert sum(1 for now_ns, _ in order if now_ns == 1_000_000_000) == 5

    run(main)


def test_phase_moves_every_tick_by_same_time() -> None:
    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop, 0.033)
        ticker = Ticker(clock, 0.05, stage=2, phase_ns=4 * MS_NS)
        for _ in range(20):
            await anext(ticker)
            assert clock.now_ns() % 50_000_000 == 4_000_000

    run(main)


@pytest.mark.parametrize(("late_ns", "turns"), [(0, 3), (LATE_NS // 2, 3), (2 * LATE_NS, 0)])
def test_late_task_does_not_wait_for_stages(late_ns: int, turns: int) -> None:
    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop, 0.0, 0.0)
        start_ns = clock.now_ns()
        late, in_time = (asyncio.create_task(until(clock, start_ns - late_ns, stage)) for stage in (4, 0))
        await in_time
        needed = 0
        while not late.done():
            await asyncio.sleep(0)
            needed += 1
        assert needed == turns

    run(main)
