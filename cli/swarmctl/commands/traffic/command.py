"""`swarmctl traffic`: rules of channels, bytes and frames per link and channel."""

from typing import Final

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_path
from swarmctl.commandline.settings import settings

SORT_KEYS: Final = (
    "bytes",
    "offered",
    "sent",
    "resent",
    "held",
    "dropped",
    "delivered",
    "received",
    "name",
)
"""Columns of `traffic.top.SortKey`, repeated here because that module is imported when the command runs."""


@click.group(cls=Group)
def cmd() -> None:
    """Rates, channels and costs of the values between nodes.

    `channels` shows at which rate each resource is sent to each platform, and where the rate was set; `set`,
    `undo` and `clear` change it. `top` shows the present traffic, `ls` the totals since the start, and
    `needs` compares the traffic with the capacity of a link.

    Example: swarmctl traffic top --node uav1
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the traffic of platforms since the start of their brokers: by link, by channel, and refused input.

    `traffic top` shows the present rates.

    Example: swarmctl traffic ls --node uav1
    """
    from swarmctl.commands.traffic.counters import list_counters
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_counters)


@cmd.command()
@click.option(
    "--period",
    "period_s",
    type=click.FloatRange(min=0.2),
    default=1.0,
    show_default=True,
    metavar="SECONDS",
    help="Period of the output.",
)
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N periods.")
@click.option(
    "--sort",
    type=click.Choice(SORT_KEYS),
    default="bytes",
    show_default=True,
    help="Column that orders the tables, the largest first.",
)
@click.option(
    "--only",
    type=click.Choice(["links", "channels", "limited"]),
    help="One of the tables: by link, by channel, or the channels whose rate has a limit.",
)
@click.pass_context
def top(ctx: click.Context, period_s: float, count: int | None, sort: str, only: str | None) -> None:
    """Follow the rates at which links and channels send, repeat, hold back, drop and deliver; Ctrl-C ends it.

    `traffic ls` shows the totals since the start, `traffic channels` the rates that are set.

    Example: swarmctl traffic top --node uav1 --sort dropped --count 5
    """
    from swarmctl.commands.traffic.top import SortKey, TrafficTable, follow_rates
    from swarmctl.session.session import run

    parts = (TrafficTable(only),) if only else tuple(TrafficTable)
    run(settings(ctx), follow_rates, period_s, count, SortKey(sort), parts)


@cmd.command(name="set")
@click.argument("pattern")
@click.option("--link", metavar="PLATFORMS", default="", help="Name or pattern of receivers; by default all.")
@click.option(
    "--rate",
    metavar="RATE",
    help="5hz, 0hz to send nothing, max for no limit, auto to follow the link, default to clear it.",
)
@click.option(
    "--protocol",
    type=click.Choice(["udp", "zmq", "rtp", "auto"]),
    help="For boards udp (beacons) or zmq (notifications), for images rtp (video).",
)
@click.option(
    "--compress", metavar="METHOD", help="none, zlib:6, zstd:3, auto; for images jpeg:80 or h264 (video)."
)
@click.option("--buffer", metavar="SIZE/TIME", help="Limit of the queue: 2MB/30s, 2MB or 30s.")
@click.option(
    "--priority",
    type=click.Choice(["high", "normal", "low", "auto"]),
    help="Order among the channels to one platform.",
)
@click.option(
    "--for",
    "span",
    metavar="TIME",
    default="",
    help="Time such as 30s or 5m, after which the former settings return.",
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def set_(
    ctx: click.Context,
    pattern: str,
    link: str,
    rate: str | None,
    protocol: str | None,
    compress: str | None,
    buffer: str | None,
    priority: str | None,
    span: str,
    yes: bool,
) -> None:
    """Set rate, protocol, compression, buffer and priority of matching resources; then show all rules.

    `--rate auto` drops items of streams that the link cannot carry, and `auto:30hz` sets a limit as well;
    boards by notification always follow the link. `--rate default`, or `auto` for protocol, buffer and
    priority, clears the value in the rule. A confirmation is needed if the rate silences resources or slows
    the states that barriers wait for.

    Example: swarmctl traffic set 'sensor/**' --rate 5hz --compress zstd:1 --buffer 2MB/30s -n uav1
    """
    from swarmctl.commands.traffic.channels import change, duration_s, set_channel
    from swarmctl.session.each_node import run_each
    from swarmware.types.channel import SetChannel, check_rule_names

    if not any((rate, protocol, compress, buffer, priority)):
        raise click.UsageError("expected --rate, --protocol, --compress, --buffer or --priority")
    chosen, local = at_path(ctx, pattern)
    check_rule_names(local, link)  # invalid ones are refused before the node is joined
    settings_, unset = change(rate, protocol, compress, buffer, priority)
    request = SetChannel(local, settings_, duration_s(span), link, unset)
    run_each(chosen, set_channel, request, yes=yes)


@cmd.command()
@click.pass_context
def undo(ctx: click.Context) -> None:
    """Undo an operator's last change of the rules of channels; then show all rules.

    Example: swarmctl traffic undo --node uav1
    """
    from swarmctl.commands.traffic.channels import undo_channel
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), undo_channel)


@cmd.command()
@click.argument("pattern", default="")
@click.pass_context
def clear(ctx: click.Context, pattern: str) -> None:
    """Remove the rules of channels that operators have set; the rules of channels.toml stay.

    Example: swarmctl traffic clear 'sensor/**' --node uav1
    """
    from swarmctl.commands.traffic.channels import clear_channels
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, pattern)
    run_each(chosen, clear_channels, local)


@cmd.command()
@click.argument("pattern", default="**")
@click.pass_context
def channels(ctx: click.Context, pattern: str) -> None:
    """Show the rate of each resource to each platform, where the rate was set, and the state of its queue.

    SET BY names the origin of the rate: traffic set, tree rule, channels.toml, tree.toml of the subscriber,
    rate_hz of the resource, or a default. SET AT has the node and the pattern of the rule.

    Example: swarmctl traffic channels 'nav/**' --node uav1
    """
    from swarmctl.commands.traffic.channels import list_channels
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, pattern)
    run_each(chosen, list_channels, local)


@cmd.command()
@click.argument("pattern", default="**")
@click.option(
    "--capacity",
    metavar="RATE",
    help="Capacity of the link, such as 250kbit, 5mbit or 1gbit; by default the measured one.",
)
@click.option(
    "--link",
    metavar="PLATFORM",
    default="",
    help="Receiver whose rules and measured capacity count; by default the rules for all receivers.",
)
@click.pass_context
def needs(ctx: click.Context, pattern: str, capacity: str | None, link: str) -> None:
    """Compare the needs of resources with the capacity of a link, and show the rates at which they fit.

    The capacity is stated, or measured by the node while the link was the limit; if both are known, both
    are compared.

    Example: swarmctl traffic needs 'sensor/**' --capacity 1mbit --node uav1
    """
    from swarmctl.commands.traffic.needs import show_needs
    from swarmctl.session.each_node import run_each
    from swarmctl.terminal.quantities import bit_rate_bytes_s
    from swarmware.types.channel import check_rule_names

    if not (capacity or link):
        raise click.UsageError("expected --capacity, or --link with a neighbour whose link was measured")
    chosen, local = at_path(ctx, pattern)
    check_rule_names(local, link)
    run_each(chosen, show_needs, local, link, bit_rate_bytes_s(capacity) if capacity else None)
