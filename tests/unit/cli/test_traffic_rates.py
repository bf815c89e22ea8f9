"""Rates of channels: from the counters at the beginning and at the end of each period."""

import json
from typing import Any, cast

import msgspec
import pytest
from tests.unit.cli.session import R, ScriptedSession

from swarmctl.commands.traffic import top
from swarmctl.commands.traffic.command import SORT_KEYS
from swarmctl.commands.traffic.limited import LimitedChannel, limited
from swarmctl.commands.traffic.rates import ChannelRates, LinkRates, rates
from swarmware.errors import NotFound
from swarmware.testing.client import FakeClient
from swarmware.testing.virtual import VirtualClock, VirtualTime
from swarmware.types.channel import RATE_MAX_HZ, ChannelSettings, ChannelState, ChannelStates
from swarmware.types.net import LinkTransport
from swarmware.types.traffic import ChannelTraffic, LinkTraffic, Traffic

S = 1_000_000_000
AUTO = ChannelSettings(RATE_MAX_HZ, adaptive=True)


class CountingSession(ScriptedSession):
    """A broker with a channel that is offered ten values a second; its answers take 10 ms."""

    def __init__(self, began_ns: int, restart_ns: int = 1 << 62) -> None:
        self.restart_ns = restart_ns
        self.time = VirtualTime()
        self.time.run_until(began_ns)
        super().__init__({}, FakeClient(clock=VirtualClock(self.time)), output="jsonl")

    async def ask(self, path: str, value: msgspec.Struct, reply: type[R], **_: Any) -> R:
        self.time.run_for(0.01)
        if reply is ChannelStates:
            raise NotFound("no tree service runs there")
        since_ns = self.restart_ns if self.time.now_ns > self.restart_ns else 0
        pose = ChannelTraffic("nav/pose", offered_frames=10 * (self.time.now_ns - since_ns) // S)
        counters = msgspec.convert([0] * 16 + [1.0, []], Traffic)
        found = msgspec.structs.replace(counters, since_ns=since_ns, at_ns=self.time.now_ns, channels=(pose,))
        assert isinstance(found, reply), path
        return found


@pytest.mark.parametrize("began_ns", [0, S // 2, 2 * S - 1])
async def test_each_rate_covers_whole_period(began_ns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    session = CountingSession(began_ns)
    for rate in await offered(session, 3, monkeypatch):
        assert rate == pytest.approx(10, abs=0.5)
    assert session.time.now_ns >= began_ns + 6 * S


async def test_restart_of_broker_makes_no_negative_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    found = await offered(CountingSession(90 * S, restart_ns=93 * S), 3, monkeypatch)
    assert found == pytest.approx([10, 10, 10], abs=0.5)


async def offered(session: CountingSession, count: int, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The rates that a command shows in periods of two seconds."""

    async def until(_clock: VirtualClock, instant_ns: int) -> None:
        session.time.run_until(instant_ns)

    monkeypatch.setattr(top, "until", until)
    await top.follow_rates(session, 2.0, count)
    periods = [json.loads(line) for line in session.stdout.getvalue().splitlines()]
    assert len(periods) == count
    return [pose["offered_hz"] for period in periods for pose in period["channels"]]


def reading(at_s: float, channel: ChannelTraffic, *links: LinkTraffic) -> Traffic:
    counters = msgspec.convert([0] * 16 + [1.0, []], Traffic)
    return msgspec.structs.replace(counters, at_ns=round(at_s * S), channels=(channel,), links=links)


BEFORE = reading(0, ChannelTraffic("cmd/goto"), LinkTraffic("uav2", LinkTransport.UDP))
AFTER = reading(
    2,
    ChannelTraffic(
        "cmd/goto",
        offered_frames=20,
        sent_frames=22,
        sent_bytes=2200,
        received_frames=4,
        received_bytes=400,
        dropped=2,
        held_back=6,
        repeated_frames=8,
        repeated_bytes=800,
        delivered_frames=18,
    ),
    LinkTraffic(
        "uav2",
        LinkTransport.UDP,
        sent_frames=40,
        sent_bytes=4000,
        received_frames=10,
        received_bytes=1000,
        lost=4,
        dropped=2,
        repeated_bytes=500,
        offered_frames=24,
        delivered_frames=20,
        waiting_frames=3,
        waiting_bytes=700,
    ),
)


def test_link_and_channel_have_all_their_rates() -> None:
    found = rates("uav1", BEFORE, AFTER)
    assert found.channels == [
        ChannelRates("cmd/goto", 10, 11, 1100, 2, 200, 1, 3, 4, 400, delivered_hz=9),
    ]
    assert found.links == [LinkRates("uav2", "udp", 12, 20, 2000, 5, 500, 250, 1, 10, 2, 3, 700)]
    assert rates("uav1", AFTER, msgspec.structs.replace(AFTER, at_ns=3 * S)).channels == []


class ShownSession(ScriptedSession):
    """A broker with two channels and two links, for a person who reads a table."""

    def __init__(self, is_limited: bool = False) -> None:
        self.is_limited = is_limited
        self.time = VirtualTime()
        super().__init__({}, FakeClient(clock=VirtualClock(self.time)))

    async def ask(self, path: str, value: msgspec.Struct, reply: type[R], **_: Any) -> R:
        self.time.run_for(1)
        now = self.time.now_ns // S
        if reply is ChannelStates:
            scan = ChannelState("map/scan", "uav2", AUTO, 3, 900, 0, 40 * now, 62.5, "queue of 84 ms")
            free = ChannelState("map/tiles", "uav2", AUTO, 0, 0, 0, 0, None, "the link carries all")
            return cast("R", ChannelStates((scan, free) if self.is_limited else ()))
        slow = ChannelTraffic("a/slow", sent_bytes=10 * now, dropped=7 * now)
        fast = ChannelTraffic("b/fast", sent_bytes=1000 * now)
        found = msgspec.structs.replace(
            AFTER,
            at_ns=self.time.now_ns,
            channels=(slow, fast),
            links=(
                LinkTraffic("uav2", LinkTransport.UDP, sent_bytes=1000 * now),
                LinkTraffic(
                    "uav3", LinkTransport.UDP, sent_bytes=10 * now, waiting_bytes=9, waiting_frames=1
                ),
            ),
        )
        assert isinstance(found, reply), path
        return found


@pytest.mark.parametrize(
    ("sort", "order"),
    [
        ("bytes", ["uav2", "uav3", "b/fast", "a/slow"]),
        ("dropped", ["uav2", "uav3", "a/slow", "b/fast"]),
        ("held", ["uav3", "uav2", "a/slow", "b/fast"]),
        ("name", ["uav2", "uav3", "a/slow", "b/fast"]),
    ],
)
async def test_tables_are_ordered_by_requested_column(
    sort: str, order: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = ShownSession()
    text = await shown(session, monkeypatch, top.SortKey(sort))
    firsts = [line.split()[0] for line in text.splitlines() if line.startswith(("uav", "a/", "b/"))]
    assert firsts == order
    assert text.startswith("gcs: "), "the sum of the node is above the tables"


async def test_either_of_two_tables_can_be_requested(monkeypatch: pytest.MonkeyPatch) -> None:
    text = await shown(ShownSession(), monkeypatch, parts=(top.TrafficTable.LINKS,))
    assert "uav2" in text
    assert "CHANNEL" not in text


@pytest.mark.parametrize(("width", "says"), [(200, False), (60, True)])
async def test_columns_without_room_are_named(
    width: int, says: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = ShownSession()
    monkeypatch.setattr(type(session.out), "width", property(lambda _out: width))
    text = await shown(session, monkeypatch, parts=(top.TrafficTable.CHANNELS,))
    assert ("-o wide also shows RE-SENT /s, HELD BACK /s, DELIVERED /s" in text) is says


async def test_limited_channel_is_shown_with_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = await shown(ShownSession(is_limited=True), monkeypatch)
    [line] = [line for line in text.splitlines() if line.startswith("map/")]
    assert line.split()[:5] == ["map/scan", "uav2", "62.5", "40.0", "3"]
    assert line.endswith("queue of 84 ms")
    assert "LIMITED" not in await shown(ShownSession(), monkeypatch)
    only = await shown(ShownSession(), monkeypatch, parts=(top.TrafficTable.LIMITED,))
    assert "no limited" in only


def test_counter_that_began_again_makes_no_negative_rate() -> None:
    before, now = (
        ChannelStates((ChannelState("map/scan", "uav2", AUTO, 0, 0, 0, held, 5.0, "set"),))
        for held in (90, 3)
    )
    for former in (before, None):
        assert limited(former, now, 2.0) == [LimitedChannel("map/scan", "uav2", 5.0, "set", 0.0, 0)]


def test_the_help_offers_the_columns_that_exist() -> None:
    assert list(SORT_KEYS) == list(top.SortKey)


async def shown(
    session: ShownSession,
    monkeypatch: pytest.MonkeyPatch,
    sort: top.SortKey = top.SortKey.BYTES,
    parts: tuple[top.TrafficTable, ...] = tuple(top.TrafficTable),
) -> str:
    """What one period prints."""

    async def until(_clock: VirtualClock, instant_ns: int) -> None:
        session.time.run_until(instant_ns)

    monkeypatch.setattr(top, "until", until)
    await top.follow_rates(session, 2.0, 1, sort, parts)
    return session.stdout.getvalue()
