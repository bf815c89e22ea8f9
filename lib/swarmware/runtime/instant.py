"""Instants of the node's clock: a process that waits for the same one in several places wakes once."""

import asyncio
from typing import Final

from swarmware.runtime.core import HardwareClock

_MS_NS: Final = 1_000_000

STAGE_NS: Final = 2_000_000
"""Between two stages of one instant where each is a process of its own: to wake, to compute a sample and to
write it takes a millisecond at most on a processor that has time."""


def stage_phase_ns(processes: str, stage: int) -> int:
    """How much later than an instant a stage of it begins; `processes`: as in node.toml."""
    return 0 if processes == "one" else stage * STAGE_NS  # within one process the order does it


def wait_s(clock: HardwareClock, instant_ns: int) -> float:
    """How long a timer of the event loop, which counts whole milliseconds, must run to end at an instant.

    Its end is rounded up to a millisecond, not its span: otherwise those who wait for the same instant since
    different moments would be woken a millisecond apart.
    """
    now_ms = clock.to_mono_ns(clock.now_ns()) // _MS_NS
    end_ms = -(-clock.to_mono_ns(instant_ns) // _MS_NS)
    return max(end_ms - now_ms, 0) / 1000


async def until(clock: HardwareClock, instant_ns: int, stage: int = 0) -> None:
    """Waits for an instant: never returns before it, and two milliseconds later at most on a calm processor.

    `stage`: of tasks that one instant wakes, those of a lower stage run first, up to their next wait.
    """
    await asyncio.sleep(wait_s(clock, instant_ns))
    for _ in range(stage):
        await asyncio.sleep(0)
