"""Frames of other units are held back for a time between two limits, in their order."""

import asyncio

import pytest
from tests.patience import PATIENCE_S

from swarmd.broker.config import Config
from swarmd.broker.links.unit_delay import UnitDelay
from swarmware.errors import ConfigError
from swarmware.model.config import convert


async def test_frames_are_delivered_later_and_in_order() -> None:
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    delay = UnitDelay(2.0, 8.0)
    found: list[int] = []
    began_s = loop.time()

    def deliver(number: int) -> None:
        found.append(number)
        if number == 19:
            done.set()

    for number in range(20):
        delay.hold(lambda number=number: deliver(number))  # type: ignore[misc]
    assert found == []
    await asyncio.wait_for(done.wait(), PATIENCE_S)
    assert found == list(range(20))
    assert loop.time() - began_s >= 0.002


async def test_frames_that_are_held_back_at_the_end_are_dropped() -> None:
    delay = UnitDelay(1.0, 1.0)
    found: list[int] = []
    delay.hold(lambda: found.append(1))
    delay.close()
    await asyncio.sleep(0.01)
    assert found == []


@pytest.mark.parametrize("delays", [[1.0], [8.0, 2.0], [1.0, 2.0, 3.0]])
def test_a_delay_has_two_limits_the_shorter_one_first(delays: list[float]) -> None:
    with pytest.raises(ConfigError, match=r"unit_delay_ms: .*expected two values"):
        convert({"unit_delay_ms": delays}, Config, "broker.toml")
    assert convert({"unit_delay_ms": [2.0, 8.0]}, Config, "broker.toml").unit_delay_ms == (2.0, 8.0)
