"""Rates of channels: from the counters at the beginning and at the end of each period."""

import json
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest
from tests.unit.cli.test_commands import R, ScriptedSession

from swarmctl.commands.traffic import rates
from swarmware.module.module import Module
from swarmware.testing.virtual import VirtualClock, VirtualTime
from swarmware.types.net import ChannelTraffic, Traffic

S = 1_000_000_000


class CountingSession(ScriptedSession):
    """A broker with a channel that is offered ten values a second; its answers take 10 ms."""

    def __init__(self, began_ns: int) -> None:
        super().__init__({}, output="jsonl")
        self.time = VirtualTime()
        self.time.run_until(began_ns)
        module = SimpleNamespace(platform="gcs", clock=VirtualClock(self.time))
        self.module = cast("Module", module)

    async def ask(self, path: str, value: msgspec.Struct, reply: type[R], **_: Any) -> R:
        self.time.run_for(0.01)
        pose = ChannelTraffic("nav/pose", offered_frames=10 * self.time.now_ns // S)
        counters = msgspec.convert([0] * 16 + [1.0, []], Traffic)
        found = msgspec.structs.replace(counters, at_ns=self.time.now_ns, channels=(pose,))
        assert isinstance(found, reply), path
        return found


@pytest.mark.parametrize("began_ns", [0, S // 2, 2 * S - 1])
async def test_each_rate_is_that_of_a_whole_period_whenever_the_command_began(
    began_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = CountingSession(began_ns)

    async def until(_clock: VirtualClock, instant_ns: int) -> None:
        session.time.run_until(instant_ns)

    monkeypatch.setattr(rates, "until", until)
    await rates.follow_rates(session, 2.0, 3)
    periods = [json.loads(line) for line in session.stdout.getvalue().splitlines()]
    assert len(periods) == 3
    for period in periods:
        (pose,) = period["channels"]
        assert pose["offered_hz"] == pytest.approx(10, abs=0.5)
    assert session.time.now_ns >= began_ns + 6 * S
