"""Steps of a mission are recorded together, at an instant of the node's clock, with their own stamps."""

import asyncio
import logging

import pytest
from tests.patience import PATIENCE_S

from swarmd.mission.progress_record import PERIOD_NS, ProgressRecord
from swarmware.model.clock import Clock
from swarmware.types.mission import MissionProgress


class Written:
    """A writer of events that keeps them, with the stamps they got and the instants of their writing."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.found: list[tuple[str, int | None]] = []
        self.at_ns: list[int] = []
        self._more = asyncio.Event()

    def write(self, value: MissionProgress, stamp_ns: int | None = None) -> int:
        self.found.append((value.event, stamp_ns))
        self.at_ns.append(self._clock.now_ns())
        self._more.set()
        return len(self.found)

    async def until(self, count: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.found) < count:
                self._more.clear()
                await self._more.wait()


def step(event: str, at_ns: int, block: str = "") -> MissionProgress:
    return MissionProgress("formation", 7, block, "Mission", event, at_ns)


async def test_steps_are_written_in_order_with_stamps() -> None:
    clock = Clock()
    writer = Written(clock)
    record = ProgressRecord(writer, clock, lambda steps: None)
    began_ns = clock.now_ns()
    record.add(step("state:ready", began_ns))
    record.add(step("state:running", began_ns + 1))
    assert not writer.found, "whoever reports a step does not wait until it is written"
    await writer.until(2)
    assert writer.found == [("state:ready", began_ns), ("state:running", began_ns + 1)]
    assert writer.at_ns[0] // PERIOD_NS > began_ns // PERIOD_NS, "at a shared instant or later"


async def test_step_after_written_one_is_written_too() -> None:
    clock = Clock()
    writer = Written(clock)
    record = ProgressRecord(writer, clock, lambda steps: None)
    record.add(step("state:ready", 1))
    await writer.until(1)
    record.add(step("state:running", 2))
    await writer.until(2)


async def test_what_is_left_at_the_end_is_written() -> None:
    clock = Clock()
    writer = Written(clock)
    kept: list[MissionProgress] = []
    record = ProgressRecord(writer, clock, kept.extend)
    record.add(step("state:aborted", 5))
    record.close()
    assert [each.event for each in kept] == ["state:aborted"]
    assert writer.found == [("state:aborted", 5)]
    record.close()
    assert len(writer.found) == 1


async def test_state_change_is_info_step_is_debug(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = Clock()
    record = ProgressRecord(Written(clock), clock, lambda steps: None)
    with caplog.at_level(logging.DEBUG, "swarm.mission"):
        record.add(step("state:ready", 1))
        record.add(step("started", 2, block="goto"))
        record.close()
    assert [(each.levelname, each.message) for each in caplog.records] == [
        ("INFO", "formation mission: state:ready "),
        ("DEBUG", "formation goto: started "),
    ]
