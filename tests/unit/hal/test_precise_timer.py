"""The timer of fast drivers never ends early, and can be set again."""

import asyncio
import time

import pytest

from swarmd.hal.precise_timer import PreciseTimer


async def test_timer_returns_at_or_after_its_instant() -> None:
    timer = PreciseTimer()
    try:
        for ahead_ns in (1_300_000, 10_000, 0, -5_000_000_000, 2_000_001):
            due_ns = time.monotonic_ns() + ahead_ns
            async with asyncio.timeout(20.0):
                await timer.until(due_ns)
            assert time.monotonic_ns() >= due_ns
    finally:
        timer.close()


async def test_cancelled_wait_does_not_end_next() -> None:
    timer = PreciseTimer()
    try:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.001):
                await timer.until(time.monotonic_ns() + 30_000_000)
        due_ns = time.monotonic_ns() + 60_000_000
        await timer.until(due_ns)
        assert time.monotonic_ns() >= due_ns
    finally:
        timer.close()
