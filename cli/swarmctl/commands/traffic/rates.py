"""Rates of a broker's channels, from its counters, and limits set by an operator."""

from typing import Final

import click
import msgspec

from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.output import Column
from swarmware.model import names
from swarmware.model.names import Pattern
from swarmware.types.net import ChannelLimits, SetChannel, Traffic
from swarmware.types.rpc import Empty

MISSION_STATE: Final = "mission/state"
"""Board that the barriers of a mission work through."""


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
    """Prints the rate of each channel once per period; ends after `count` periods, when one is given."""
    before = await session.ask("sys/broker/traffic", Empty(), Traffic)
    turn = 0
    async for _ in session.module.every(period_s):
        now = await session.ask("sys/broker/traffic", Empty(), Traffic)
        if now.at_ns == before.at_ns:
            continue
        _show_rates(session, before, now)
        before = now
        turn += 1
        if turn == count:
            return


def _show_rates(session: Session, before: Traffic, now: Traffic) -> None:
    span_s = (now.at_ns - before.at_ns) / 1e9
    old = {one.channel: one for one in before.channels}
    rates = []
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
            rates.append((one.channel, *deltas))
    rates.sort(key=lambda row: -(row[3] + row[5]))
    total = (
        (now.sent_bytes - before.sent_bytes) / span_s,
        (now.received_bytes - before.received_bytes) / span_s,
    )
    if session.settings.structured:
        channels = [ChannelRates(*row) for row in rates]
        session.out.line(TrafficRates(session.platform, now.at_ns, *total, channels))
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
        Column("HELD BACK /s", right=True),
    ]
    title = f"{session.platform}: {total[0] / 1000:.2f} kB/s out, {total[1] / 1000:.2f} kB/s in, on the wire"
    session.out.table(columns, [(row[0], *(f"{rate:.1f}" for rate in row[1:])) for row in rates], title)


def effect(local: str, max_hz: float | None, duration_s: float) -> str:
    """What a limit does to the swarm that an operator must confirm; empty: no confirmation."""
    end = f"for {duration_s:g} s" if duration_s else "without an end"
    if max_hz == 0.0:
        return f"boards that match {local} are not sent {end}"
    if max_hz is not None and Pattern(local).matches(MISSION_STATE):
        return f"{MISSION_STATE} is sent at {max_hz:g} Hz at most {end}: barriers of a mission wait for it"
    return ""


async def set_limit(
    session: Session, pattern: str, max_hz: float | None, duration_s: float, *, yes: bool
) -> None:
    """Limits matching boards and prints all limits; `max_hz` None: no limit, `duration_s` 0: no end.

    Raises: as `confirm` and `Session.ask`.
    """
    platform, local = names.split(pattern)
    request = SetChannel(Pattern(local).text, max_hz, duration_s)
    target = names.check_platform(platform or session.platform)
    await session.reach(target)
    if will := effect(local, max_hz, duration_s):
        confirm(yes, f"{target}: {will}")
    limits = await session.ask(names.join(target, "sys/broker/set_channel"), request, ChannelLimits)
    for path in limits.unlimited:
        session.out.warn(f"/{target}/{path}: not limited, because each of its items is delivered")
    traffic = await session.ask(names.join(target, "sys/broker/traffic"), Empty(), Traffic)
    if not any(Pattern(local).matches(one.channel) for one in traffic.channels):
        session.out.warn(f"{target} has not sent a board that matches {local} yet; the limit is in force")
    if session.settings.structured:
        session.out.document(limits)
        return
    rows = [(one.pattern, one.max_hz, one.remaining_s) for one in limits.limits]
    session.out.table([Column("PATTERN"), Column("MAX HZ", right=True), Column("LEFT s", right=True)], rows)
