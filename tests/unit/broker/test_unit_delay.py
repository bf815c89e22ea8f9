"""Frames of other units are held back for a time between two limits, in their order."""

import asyncio

import pytest
from tests.unit.runtime.virtual_loop import VirtualLoop, run

from swarmd.broker.config import Config
from swarmd.broker.exchange.unit_delay import UnitDelay
from swarmware.errors import ConfigError
from swarmware.model.config import convert


def test_frames_are_delivered_later_and_in_order() -> None:
    found: list[int] = []

    async def main(loop: VirtualLoop) -> None:
        delay = UnitDelay(2.0, 8.0)
        for number in range(20):
            delay.hold(lambda number=number: found.append(number))  # type: ignore[misc]
        await asyncio.sleep(0.001)
        assert found == []
        await asyncio.sleep(1.0)
        assert found == list(range(20))

    run(main)


def test_frames_held_back_at_end_are_dropped() -> None:
    found: list[int] = []

    async def main(loop: VirtualLoop) -> None:
        delay = UnitDelay(1.0, 1.0)
        delay.hold(lambda: found.append(1))
        delay.close()
        await asyncio.sleep(1.0)

    run(main)
    assert found == []


@pytest.mark.parametrize("delays", [[1.0], [8.0, 2.0], [1.0, 2.0, 3.0]])
def test_delay_has_two_limits_shorter_one_first(delays: list[float]) -> None:
    with pytest.raises(ConfigError, match=r"unit_delay_ms: .*expected two values"):
        convert({"unit_delay_ms": delays}, Config, "broker.toml")
    assert convert({"unit_delay_ms": [2.0, 8.0]}, Config, "broker.toml").unit_delay_ms == (2.0, 8.0)
