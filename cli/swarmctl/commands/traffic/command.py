"""`swarmctl traffic`: bytes and frames per channel; set a channel's rate."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_path
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Bytes and frames per link and channel; set a channel's rate.

    Example: swarmctl traffic top --node uav1
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the traffic of platforms since the start of their brokers: by link, by channel, and refused input.

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
@click.pass_context
def top(ctx: click.Context, period_s: float, count: int | None) -> None:
    """Follow the rate of each channel, from the counters of brokers; Ctrl-C ends it.

    Example: swarmctl traffic top --node uav1 --count 5
    """
    from swarmctl.commands.traffic.rates import follow_rates
    from swarmctl.session.session import run

    run(settings(ctx), follow_rates, period_s, count)


@cmd.command(name="set")
@click.argument("pattern")
@click.option("--rate", required=True, metavar="RATE", help="5hz, 0hz (nothing), or `auto` (no limit).")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--for", "span", metavar="TIME", default="", help="30s, 5m: the limit ends after that.")
@click.pass_context
def set_(ctx: click.Context, pattern: str, rate: str, span: str, yes: bool) -> None:
    """Limit the rate at which platforms send matching boards; then show all their limits.

    It asks for a confirmation where the limit silences boards, or slows the states that barriers wait for.

    Example: swarmctl traffic set 'nav/*' --rate 5hz --for 5m --node uav1
    """
    from swarmctl.commands.traffic.rates import set_limit
    from swarmctl.session.each_node import run_each
    from swarmctl.terminal.quantities import rate_hz, span_s
    from swarmware.model.names import Pattern

    chosen, local = at_path(ctx, pattern)
    Pattern(local)  # an invalid one is refused before the node is joined
    run_each(chosen, set_limit, local, rate_hz(rate), span_s(span) if span else 0.0, yes=yes)
