"""Rates of a broker's channels, from its counters."""

import click
import msgspec

from swarmctl.commandline.nodes import is_selection
from swarmctl.resources.fanout import ask_all, warn_errors
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.errors import Partial, SwarmError
from swarmware.runtime.instant import until
from swarmware.types.net import Traffic
from swarmware.types.rpc import Empty


class ChannelRates(msgspec.Struct, frozen=True):
    """Rates of one channel."""

    channel: str
    offered_hz: float
    sent_hz: float
    sent_bytes_s: float
    received_hz: float
    received_bytes_s: float
    dropped_hz: float
    held_back_hz: float


class TrafficRates(msgspec.Struct, frozen=True):
    """Rates of a platform's channels in one period."""

    platform: str
    at_ns: int
    sent_bytes_s: float
    """On the wire, of all channels."""
    received_bytes_s: float
    channels: list[ChannelRates]


async def follow_rates(session: Session, period_s: float, count: int | None) -> None:
    """Prints the rate of each channel once per period; ends after `count` periods, when one is given.

    Raises: as `Session.ask` where no platform answers; Partial when one did not answer in the last period.
    """
    asked = await session.selected() if session.settings.node else [session.platform]
    before, errors = await _traffic(session, asked)
    if not before:
        raise errors[asked[0]]
    clock = session.module.clock
    turn = 0
    while turn != count:
        # from reading to reading: a period of the clock may end just after the command began
        await until(clock, clock.now_ns() + round(period_s * 1e9))
        now, errors = await _traffic(session, asked)
        if not now and len(asked) == 1:
            raise errors[asked[0]]
        rates = [
            _rates(name, before[name], one)
            for name, one in now.items()
            if name in before and one.at_ns != before[name].at_ns
        ]
        before |= now
        if not rates and now:
            continue
        _show_rates(session, rates, several=is_selection(session.settings.node))
        warn_errors(session, errors)
        turn += 1
    if errors:
        raise Partial(f"traffic: {', '.join(errors)} did not answer")


async def _traffic(session: Session, asked: list[str]) -> tuple[dict[str, Traffic], dict[str, SwarmError]]:
    return await ask_all(session, asked, "sys/broker/traffic", Empty(), Traffic)


def _rates(platform: str, before: Traffic, now: Traffic) -> TrafficRates:
    """Rates between two readings, channels with the most bytes first.

    After a restart of the broker in between, rates since that restart: its counters began again.
    """
    if now.since_ns != before.since_ns:
        before = msgspec.structs.replace(
            before, at_ns=now.since_ns, sent_bytes=0, received_bytes=0, channels=()
        )
    span_s = (now.at_ns - before.at_ns) / 1e9
    old = {one.channel: one for one in before.channels}
    channels = []
    for one in now.channels:
        was = old.get(one.channel)
        deltas = [
            (getattr(one, field) - (getattr(was, field) if was else 0)) / span_s
            for field in (
                "offered_frames",
                "sent_frames",
                "sent_bytes",
                "received_frames",
                "received_bytes",
                "dropped",
                "held_back",
            )
        ]
        if any(deltas):
            channels.append(ChannelRates(one.channel, *deltas))
    channels.sort(key=lambda one: -(one.sent_bytes_s + one.received_bytes_s))
    return TrafficRates(
        platform,
        now.at_ns,
        (now.sent_bytes - before.sent_bytes) / span_s,
        (now.received_bytes - before.received_bytes) / span_s,
        channels,
    )


def _show_rates(session: Session, rates: list[TrafficRates], *, several: bool) -> None:
    """Prints a line per platform for programs, else one table; `several`: with a column of the node."""
    if session.settings.structured:
        for one in rates:
            session.out.line(one)
        return
    if session.out.fancy:
        click.clear()
    columns = [
        Column("CHANNEL"),
        Column("OFFERED /s", right=True),
        Column("SENT /s", right=True),
        Column("B/s", right=True),
        Column("RECEIVED /s", right=True),
        Column("B/s", right=True),
        Column("DROPPED /s", right=True),
        Column("HELD BACK /s", right=True, drop=1),
    ]
    rows = []
    for one in rates:
        for channel in one.channels:
            name, *figures = msgspec.structs.astuple(channel)
            rows.append((*((one.platform,) if several else ()), name, *(f"{rate:.1f}" for rate in figures)))
    sent = sum(one.sent_bytes_s for one in rates) / 1000
    received = sum(one.received_bytes_s for one in rates) / 1000
    whose = f"{len(rates)} nodes" if several else session.platform
    title = f"{whose}: {sent:.2f} kB/s out, {received:.2f} kB/s in, on the wire"
    session.out.table(
        [*((Column("NODE"),) if several else ()), *columns], rows, title, empty=f"{title}; no channels"
    )
