"""`swarmctl tree`: resources: list, read, set and watch them."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.completion_cache import VALUED
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings


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
@click.argument("path", shell_complete=completion.resources(VALUED))
@click.option("--fresh", is_flag=True, help="Query the owner even if there is a fresh mirror.")
@click.pass_context
def get(ctx: click.Context, path: str, fresh: bool) -> None:
    """Print the newest value of a resource, or of one of its fields; a pattern gives the values of all.

    Example: swarmctl tree get /uav1/nav/pose.x_m
    """
    from swarmctl.commands.tree.reading import print_values
    from swarmctl.session.session import run

    run(settings(ctx), print_values, path, fresh=fresh)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources(VALUED | {"command"}, "w"))
@click.argument("value")
@click.option(
    "--if-version", "version", type=int, metavar="N", help="Set it only if it still has this version."
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation, such as for arming.")
@click.pass_context
def set_(ctx: click.Context, path: str, value: str, version: int | None, yes: bool) -> None:
    """Set a resource, or one of its fields; the owner checks type, range and permission.

    It asks for a confirmation where the template of the resource requires one.

    Example: swarmctl tree set /uav1/config/navigator/altitude_kp 1.5
    """
    from swarmctl.resources.access import set_resource
    from swarmctl.session.session import run

    run(settings(ctx), set_resource, path, value, version=version, yes=yes)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED))
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N values.")
@click.pass_context
def watch(ctx: click.Context, path: str, count: int | None) -> None:
    """Print each new value of a resource, of one of its fields, or of all that match; Ctrl-C ends it.

    Example: swarmctl tree watch /uav1/nav/pose --count 10 --json
    """
    from swarmctl.commands.tree.watching import print_changes
    from swarmctl.session.session import run

    run(settings(ctx), print_changes, path, count)
