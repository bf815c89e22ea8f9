"""`swarmctl tree`: resources: list, read, set and watch them."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.completion_cache import VALUED
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_path
from swarmctl.commandline.settings import settings

FIELDS = click.option(
    "--field",
    "names",
    multiple=True,
    metavar="NAME",
    shell_complete=completion.field_names,
    help="A field of the value; several are allowed.",
)

WINDOW = click.option(
    "--window",
    "window_s",
    type=click.FloatRange(min=0, min_open=True, max=86400),
    default=5.0,
    metavar="SECONDS",
    help="Time of the measurement; default: 5.",
)


@click.group(cls=Group)
def cmd() -> None:
    """Resources: list, read, set and watch them, of one platform or of the whole swarm.

    Example: swarmctl tree ls '/*/nav/**'
    """


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"branch", "command"}))
@click.pass_context
def ls(ctx: click.Context, pattern: str) -> None:
    """List resources: type, unit, rate, age and quality of the value.

    Example: swarmctl tree ls /uav1
    """
    from swarmctl.commands.tree.listing import list_resources
    from swarmctl.session.session import run

    run(settings(ctx), list_resources, pattern)


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"branch", "command"}))
@click.pass_context
def show(ctx: click.Context, pattern: str) -> None:
    """Draw the tree of resources.

    Example: swarmctl tree show /uav1
    """
    from swarmctl.commands.tree.listing import draw_resources
    from swarmctl.session.session import run

    run(settings(ctx), draw_resources, pattern)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED, fields=True))
@FIELDS
@click.option("--fresh", is_flag=True, help="Query the owner even if there is a fresh mirror.")
@click.pass_context
def get(ctx: click.Context, path: str, names: tuple[str, ...], fresh: bool) -> None:
    """Print the newest value of a resource, or of fields of it, with its time (UTC, by the clock of this
    machine), age and measured rate; a pattern gives the values of all.

    Example: swarmctl tree get /uav1/nav/pose.x_m
    """
    from swarmctl.commands.tree.reading import print_values
    from swarmctl.session.session import run

    run(settings(ctx), print_values, path, names=names, fresh=fresh)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources(VALUED | {"command"}, "w", fields=True))
@click.argument("value", shell_complete=completion.values)
@click.option(
    "--if-version", "version", type=int, metavar="N", help="Set it only if it still has this version."
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation, such as for arming.")
@click.pass_context
def set_(ctx: click.Context, path: str, value: str, version: int | None, yes: bool) -> None:
    """Set a resource, or one of its fields; the owner checks type, range and permission.

    It asks for a confirmation where the template of the resource requires one. Several platforms are set at
    the same time: '/uav*/config/navigator/altitude_kp'.

    Example: swarmctl tree set /uav1/config/navigator/altitude_kp 1.5
    """
    from swarmctl.resources.access import set_resource
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, path)
    run_each(chosen, set_resource, local, value, version=version, yes=yes)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED, fields=True))
@FIELDS
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N values.")
@click.pass_context
def watch(ctx: click.Context, path: str, names: tuple[str, ...], count: int | None) -> None:
    """Print each new value of a resource, of fields of it, or of all that match, with its time (UTC, by the
    clock of this machine), its age at the arrival and the rate of the arrivals; Ctrl-C ends it.

    Example: swarmctl tree watch /uav1/nav/pose --count 10 --json
    """
    from swarmctl.commands.tree.watching import print_changes
    from swarmctl.session.session import run

    run(settings(ctx), print_changes, path, count, names)


@cmd.command(name="type")
@click.argument("name", metavar="TYPE|PATH", shell_complete=completion.resources(VALUED | {"command"}))
@click.pass_context
def type_(ctx: click.Context, name: str) -> None:
    """Show the fields of a type, or of the types of a resource: type, unit, range, default and meaning.

    Example: swarmctl tree type /uav1/nav/pose
    """
    from swarmctl.commands.tree.types import print_type
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, name)
    run_each(chosen, print_type, local)


@cmd.command()
@click.argument("path", metavar="PATH|PATTERN", shell_complete=completion.resources(VALUED))
@WINDOW
@click.pass_context
def hz(ctx: click.Context, path: str, window_s: float) -> None:
    """Measure how often a resource is written by its owner (from the counter in its values) and arrives here,
    with the times between arrivals.

    Example: swarmctl tree hz '/*/nav/pose'
    """
    from swarmctl.commands.tree.measuring import print_rates
    from swarmctl.session.session import run

    run(settings(ctx), print_rates, path, window_s)


@cmd.command()
@click.argument("path", metavar="PATH|PATTERN", shell_complete=completion.resources(VALUED))
@WINDOW
@click.pass_context
def bw(ctx: click.Context, path: str, window_s: float) -> None:
    """Measure the payload bytes per second of resources, and the sizes of their values.

    Example: swarmctl tree bw '/*/nav/pose'
    """
    from swarmctl.commands.tree.measuring import print_bandwidths
    from swarmctl.session.session import run

    run(settings(ctx), print_bandwidths, path, window_s)


@cmd.command()
@click.argument("path", metavar="PATH|PATTERN", shell_complete=completion.resources(VALUED))
@WINDOW
@click.pass_context
def delay(ctx: click.Context, path: str, window_s: float) -> None:
    """Measure the time from the stamps of values to their arrival here, by converted clocks, with the bound
    of the conversion.

    Example: swarmctl tree delay '/*/nav/pose'
    """
    from swarmctl.commands.tree.measuring import print_delays
    from swarmctl.session.session import run

    run(settings(ctx), print_delays, path, window_s)
