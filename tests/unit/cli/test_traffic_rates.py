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

    def __init__(self, began_ns: int, restart_ns: int = 1 << 62) -> None:
        self.restart_ns = restart_ns
        super().__init__({}, output="jsonl")
        self.time = VirtualTime()
        self.time.run_until(began_ns)
        module = SimpleNamespace(platform="gcs", clock=VirtualClock(self.time))
        self.module = cast("Module", module)

    async def ask(self, path: str, value: msgspec.Struct, reply: type[R], **_: Any) -> R:
        self.time.run_for(0.01)
        since_ns = self.restart_ns if self.time.now_ns > self.restart_ns else 0
        pose = ChannelTraffic("nav/pose", offered_frames=10 * (self.time.now_ns - since_ns) // S)
        counters = msgspec.convert([0] * 16 + [1.0, []], Traffic)
        found = msgspec.structs.replace(counters, since_ns=since_ns, at_ns=self.time.now_ns, channels=(pose,))
        assert isinstance(found, reply), path
        return found


@pytest.mark.parametrize("began_ns", [0, S // 2, 2 * S - 1])
async def test_each_rate_is_that_of_a_whole_period_whenever_the_command_began(
    began_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = CountingSession(began_ns)
    for rate in await offered(session, 3, monkeypatch):
        assert rate == pytest.approx(10, abs=0.5)
    assert session.time.now_ns >= began_ns + 6 * S


async def test_a_restart_of_the_broker_makes_no_negative_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    found = await offered(CountingSession(90 * S, restart_ns=93 * S), 3, monkeypatch)
    assert found == pytest.approx([10, 10, 10], abs=0.5)


async def offered(session: CountingSession, count: int, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The rates that a command shows in periods of two seconds."""

    async def until(_clock: VirtualClock, instant_ns: int) -> None:
        session.time.run_until(instant_ns)

    monkeypatch.setattr(rates, "until", until)
    await rates.follow_rates(session, 2.0, count)
    periods = [json.loads(line) for line in session.stdout.getvalue().splitlines()]
    assert len(periods) == count
    return [pose["offered_hz"] for period in periods for pose in period["channels"]]
