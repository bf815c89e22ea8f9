"""`swarmctl traffic`: bytes and frames per channel; set a channel's rate."""

from typing import TYPE_CHECKING

import click

from swarmctl.lazy import Group
from swarmctl.settings import settings

if TYPE_CHECKING:
    from swarmctl.session import Session
    from swarmware.types.net import Traffic


@click.group(cls=Group)
def cmd() -> None:
    """Bytes and frames per link and channel; set a channel's rate.

    Example: swarmctl traffic top --node uav1
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List what a platform's broker carried since it started: by link, by channel, and what it refused.

    Example: swarmctl traffic ls --node uav1
    """
    import msgspec

    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmware.types.net import Traffic
    from swarmware.types.rpc import Empty

    async def work(session: Session) -> None:
        found = await session.ask("sys/broker/traffic", Empty(), Traffic)
        if session.settings.json:
            session.out.document(found)
            return
        names: tuple[str, ...] = (
            "SENT",
            "BYTES",
            "RECEIVED",
            "BYTES",
            "LOST",
            "LATE",
            "DUPLICATE",
            "DROPPED",
        )
        columns = [Column("LINK"), Column("BY"), *(Column(name, right=True) for name in names)]
        rows = [
            (
                one.platform,
                one.transport,
                one.sent_frames,
                one.sent_bytes,
                one.received_frames,
                one.received_bytes,
                one.lost,
                one.late,
                one.duplicates,
                one.dropped,
            )
            for one in found.links
        ]
        session.out.table(columns, rows)
        session.out.text("")
        names = (
            "OFFERED",
            "SENT",
            "BYTES",
            "RECEIVED",
            "BYTES",
            "LATE",
            "DUPLICATE",
            "DROPPED",
            "MAX HZ",
            "HELD BACK",
        )
        columns = [Column("CHANNEL"), *(Column(name, right=True) for name in names)]
        channels = [
            (
                one.channel,
                one.offered_frames,
                one.sent_frames,
                one.sent_bytes,
                one.received_frames,
                one.received_bytes,
                one.late,
                one.duplicates,
                one.dropped,
                one.max_hz,
                one.held_back,
            )
            for one in found.channels
        ]
        session.out.table(columns, channels)
        session.out.text("")
        counts = msgspec.structs.asdict(found.refused).items()
        refused = ", ".join(f"{count} {name}" for name, count in counts if count) or "nothing"
        session.out.text(
            f"refused: {refused}; requests answered: {found.requests}; values received: {found.notifications}"
        )
        if found.slowed_ticks:
            session.out.text(
                f"ticks slowed: {found.slowed_ticks}, {found.slowdown:g} times at present: processor short"
            )

    run(settings(ctx), work)


@cmd.command()
@click.option(
    "--period",
    "period_s",
    type=click.FloatRange(min=0.2),
    default=1.0,
    show_default=True,
    metavar="SECONDS",
    help="How often.",
)
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N periods.")
@click.pass_context
def top(ctx: click.Context, period_s: float, count: int | None) -> None:
    """Follow the rate of each channel, from the broker's counters; Ctrl-C ends it.

    Example: swarmctl traffic top --node uav1 --count 5
    """
    from swarmctl.session import Session, run
    from swarmware.types.net import Traffic
    from swarmware.types.rpc import Empty

    async def work(session: Session) -> None:
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

    run(settings(ctx), work)


def _show_rates(session: "Session", before: "Traffic", now: "Traffic") -> None:
    from swarmctl.output import Column

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
    if session.settings.json:
        names = (
            "channel",
            "offered_hz",
            "sent_hz",
            "sent_bytes_s",
            "received_hz",
            "received_bytes_s",
            "dropped_hz",
            "held_back_hz",
        )
        session.out.line(
            {
                "platform": session.platform,
                "at_ns": now.at_ns,
                "sent_bytes_s": total[0],
                "received_bytes_s": total[1],
                "channels": [dict(zip(names, row, strict=True)) for row in rates],
            }
        )
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


@cmd.command(name="set")
@click.argument("pattern")
@click.option("--rate", required=True, metavar="RATE", help="5hz, 0hz (nothing), or `auto` (no limit).")
@click.option("--for", "span", metavar="TIME", default="", help="30s, 5m: taken back by itself after that.")
@click.pass_context
def set_(ctx: click.Context, pattern: str, rate: str, span: str) -> None:
    """Limit the rate at which a platform sends the boards that match; shows all its limits then.

    Example: swarmctl traffic set 'nav/*' --rate 5hz --for 5m --node uav1
    """
    from swarmctl.output import Column
    from swarmctl.quantities import rate_hz, span_s
    from swarmctl.session import Session, run
    from swarmware import names
    from swarmware.names import Pattern
    from swarmware.types.net import ChannelLimits, SetChannel, Traffic
    from swarmware.types.rpc import Empty

    platform, local = names.split(pattern)
    wish = SetChannel(Pattern(local).text, rate_hz(rate), span_s(span) if span else 0.0)

    async def work(session: Session) -> None:
        target = names.check_platform(platform or session.platform)
        limits = await session.ask(f"/{target}/sys/broker/set_channel", wish, ChannelLimits)
        for path in limits.unlimited:
            session.out.warn(f"/{target}/{path}: not limited, each item of it is promised")
        traffic = await session.ask(f"/{target}/sys/broker/traffic", Empty(), Traffic)
        if not any(Pattern(local).matches(one.channel) for one in traffic.channels):
            session.out.warn(
                f"{target} has sent nothing yet that matches {local}; the limit stands for later"
            )
        if session.settings.json:
            session.out.document(limits)
            return
        rows = [(one.pattern, one.max_hz, one.remaining_s) for one in limits.limits]
        session.out.table(
            [Column("PATTERN"), Column("MAX HZ", right=True), Column("LEFT s", right=True)], rows
        )

    run(settings(ctx), work)
