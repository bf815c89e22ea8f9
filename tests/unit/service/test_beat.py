"""The beat of a process: one wake a second for all its services."""

import asyncio
from typing import cast

import pytest
from tests.unit.runtime.virtual_loop import VirtualClock, VirtualLoop, run

from swarmware.errors import Denied
from swarmware.service.status import Load, Reporter, beat


class Service:
    """A reporter that records the calls of a beat."""

    def __init__(self, clock: VirtualClock, *, late_s: float = 0.0, fails: bool = False) -> None:
        self.clock = clock
        self.late_s = late_s
        self.fails = fails
        self.beats_ns: list[int] = []
        self.loads: list[Load] = []

    def beat(self, late_s: float, load: Load) -> float:
        self.beats_ns.append(self.clock.now_ns())
        self.loads.append(load)
        if self.fails:
            raise Denied("shared memory: closed to this user")
        return max(late_s, self.late_s)


async def beats(loop: VirtualLoop, clock: VirtualClock, services: list[Service], seconds: float) -> None:
    task = asyncio.create_task(beat(clock, lambda: cast(list[Reporter], services)))
    await asyncio.sleep(seconds)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


def test_services_of_process_beat_in_one_wake() -> None:
    services: list[Service] = []

    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop, 17.83)
        services.extend(Service(clock) for _ in range(11))
        await beats(loop, clock, services, 10.5)

    loop = run(main)
    assert len(loop.virtual.wakes) == 11 + 1, "each second, and the end"
    for service in services:
        assert service.beats_ns == [(18 + count) * 1_000_000_000 for count in range(11)]
        assert service.loads == services[0].loads, "measured once for all"


def test_unwritable_beat_costs_no_other_its_beat(
    caplog: pytest.LogCaptureFixture,
) -> None:
    services: list[Service] = []

    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop)
        services.extend(Service(clock, fails=number == 1) for number in range(3))
        await beats(loop, clock, services, 4.5)

    run(main)
    assert [len(service.beats_ns) for service in services] == [4, 4, 4]
    assert [record.getMessage() for record in caplog.records] == [
        "heartbeat cannot be written: shared memory: closed to this user"
    ]


def test_late_event_loop_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    async def main(loop: VirtualLoop) -> None:
        clock = VirtualClock(loop)
        await beats(loop, clock, [Service(clock, late_s=0.2) for _ in range(11)], 5.5)

    run(main)
    assert [record.getMessage() for record in caplog.records] == ["the event loop was late by 200 ms"]
