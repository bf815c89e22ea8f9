"""Waits for instants of the node's clock: several waits of a process for one instant wake it once."""

import asyncio
from typing import Final

from swarmware.runtime.core import HardwareClock

_MS_NS: Final = 1_000_000

STAGE_NS: Final = 2_000_000
"""Time between two stages of one instant in separate processes: to wake, compute a sample and
write it take at most a millisecond on an idle processor."""


LATE_NS: Final = 100_000_000
"""Lateness above which stages are not waited for. Each is a turn of the event loop, and where the processor
is short a turn takes so long that the last stage would run a few times a second."""


def stage_phase_ns(processes: str, stage: int) -> int:
    """Offset of a stage from its instant; `processes`: as in node.toml."""
    return 0 if processes == "one" else stage * STAGE_NS  # within one process the order of tasks suffices


def wait_s(clock: HardwareClock, instant_ns: int) -> float:
    """Duration of a timer of the event loop, which has a resolution of 1 ms, that ends at an instant.

    Its end is rounded up to a millisecond, not its duration: otherwise timers for the same instant that were
    started at different times would expire a millisecond apart.
    """
    now_ms = clock.to_mono_ns(clock.now_ns()) // _MS_NS
    end_ms = -(-clock.to_mono_ns(instant_ns) // _MS_NS)
    return max(end_ms - now_ms, 0) / 1000


async def until(clock: HardwareClock, instant_ns: int, stage: int = 0) -> None:
    """Wait for an instant; returns not before it, and at most two milliseconds later on an idle processor.

    `stage`: tasks of a lower stage that wait for the same instant run first, up to their next wait, unless
    they are late.
    """
    await asyncio.sleep(wait_s(clock, instant_ns))
    for _ in range(stage):
        if clock.now_ns() - instant_ns > LATE_NS:
            return
        await asyncio.sleep(0)
