"""`swarmctl node`: nodes of the swarm."""

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_nodes, named_nodes, nodes_argument
from swarmctl.commandline.settings import settings
from swarmctl.vehicles.options import timeout_option


@click.group(cls=Group)
def cmd() -> None:
    """Nodes of the swarm.

    Example: swarmctl node ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the nodes: whether they answer, health, synchronisation, mission; mode, armed, height and battery
    of vehicles.

    SYNC compares digests: `synced 15/15` has the structures of all 15 platforms that the node follows, and
    these hold its subscriptions. `structure 14/15`: one structure differs; `values 14/15`: one platform
    lacks the subscription; `behind`: the joined node has an older structure of this one.

    Example: swarmctl node ls --json
    """
    from swarmctl.commands.node.overview import list_nodes
    from swarmctl.session.session import run

    run(settings(ctx), list_nodes)


@cmd.command()
@nodes_argument()
@click.pass_context
def info(ctx: click.Context, platforms: tuple[str, ...]) -> None:
    """Show nodes: identity, services, and path of the configuration.

    Example: swarmctl node info uav1
    """
    from swarmctl.commands.node.identity import show_node
    from swarmctl.session.each_node import run_each

    run_each(at_nodes(ctx, platforms), show_node)


@cmd.command()
@nodes_argument()
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--force", is_flag=True, help="Also of an armed vehicle.")
@timeout_option(30.0)
@click.pass_context
def restart(ctx: click.Context, platforms: tuple[str, ...], yes: bool, force: bool, wait_s: float) -> None:
    """Restart all services of nodes by their guards, one after the other; the time-out is that of each.

    Several nodes restart at the same time, the joined one after the others. An armed vehicle is refused,
    unless --force is given.

    Example: swarmctl node restart uav1 --yes
    """
    from swarmctl.resources.restart import restart
    from swarmctl.session.each_node import run_each

    run_each(at_nodes(ctx, platforms), restart, (), wait_s, yes=yes, force=force)


@cmd.command()
@nodes_argument("PLATFORM…")
@click.option("--now", is_flag=True, help="End the running mission: vehicles land.")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation, which --now requires.")
@timeout_option(600.0)
@click.pass_context
def drain(ctx: click.Context, platforms: tuple[str, ...], now: bool, yes: bool, wait_s: float) -> None:
    """Drain nodes: they take no role in a new mission until `node undrain`, also after a restart of the node.

    It waits until the running mission of each has ended; --now ends it. `node ls` and `mission status` show
    who drained a node, and `mission start` names it as the reason.

    Example: swarmctl node drain uav1
    """
    from swarmctl.commands.node import draining
    from swarmctl.session.each_node import run_each

    run_each(named_nodes(ctx, platforms), draining.drain, wait_s, now=now, yes=yes)


@cmd.command()
@nodes_argument("PLATFORM…")
@click.pass_context
def undrain(ctx: click.Context, platforms: tuple[str, ...]) -> None:
    """End the drain of nodes: they take roles in missions again.

    Example: swarmctl node undrain uav1
    """
    from swarmctl.commands.node import draining
    from swarmctl.session.each_node import run_each

    run_each(named_nodes(ctx, platforms), draining.undrain)
