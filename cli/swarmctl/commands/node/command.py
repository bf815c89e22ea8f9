"""`swarmctl node`: nodes of the swarm."""

from pathlib import Path

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import (
    PLATFORM,
    at_nodes,
    hosts_option,
    named_nodes,
    nodes_argument,
    root_option,
    timeout_option,
)
from swarmctl.commandline.secret import TOKEN
from swarmctl.commandline.settings import Nodes, settings


@click.group(cls=Group)
def cmd() -> None:
    """Nodes of the swarm.

    Example: swarmctl node ls
    """


@cmd.command()
@click.option("--units", is_flag=True, help="A row for each computer of a platform, with its services.")
@click.pass_context
def ls(ctx: click.Context, units: bool) -> None:
    """List the nodes: whether they answer, health, synchronisation, mission; mode, armed, height and battery
    of vehicles.

    SYNC compares digests: `synced 15/15` has the structures of all 15 platforms that the node follows, and
    these hold its subscriptions. `structure 14/15`: one structure differs; `values 14/15`: one platform
    lacks the subscription; `behind`: the joined node has an older structure of this one.

    Example: swarmctl node ls --json
    """
    from swarmctl.session.session import run

    if units:
        from swarmctl.commands.node.units import list_units

        run(settings(ctx), list_units)
        return
    from swarmctl.commands.node.overview import list_nodes

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
    """Restart all services of nodes by their guards, one after the other; the time-out holds for each.

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


@cmd.command(nodes=Nodes.NONE)
@click.argument("platform", metavar="PLATFORM", type=PLATFORM)
@root_option
@hosts_option
@click.option("--address", default="", metavar="HOST", help="Name or IP address, for the file of --hosts.")
@click.option(
    "--kind",
    type=click.Choice(["uav", "ugv", "usv", "gcs"]),
    default="",
    help="Kind in its node.toml, for the file of --hosts.",
)
@click.option("--template", default="", metavar="NAME", help="Template in its node.toml, for --hosts.")
@click.option(
    "--role",
    type=click.Choice(["observer", "node", "operator", "maintainer"]),
    default="node",
    show_default=True,
    help="Rights of the node at the other platforms.",
)
@click.option("--valid", default="10m", show_default=True, metavar="TIME", help="30s, 10m, 2h: time to join.")
@click.option(
    "--listen", default="", metavar="HOST[:PORT]", help="Address by which the node reaches this computer."
)
@click.option(
    "--file",
    default="",
    metavar="FILE",
    type=click.Path(dir_okay=False),
    help="Write its credentials to a file, for a node without a network.",
)
@click.pass_context
def add(
    ctx: click.Context,
    platform: str,
    root_dir: Path | None,
    hosts_file: Path | None,
    address: str,
    kind: str,
    template: str,
    role: str,
    valid: str,
    listen: str,
    file: str,
) -> None:
    """Add a node before it comes: invite it, and with --hosts enter it in the file of `swarmctl fleet`.

    The name must be free. The command prints the line that is typed on the node, and waits until the node has
    joined, as `swarmctl keys invite` does.

    Example: swarmctl node add uav4 --hosts HOSTS.toml --address 10.0.0.14 --kind uav
    """
    from swarmctl.commands.node.adding import NewNode, add_node
    from swarmctl.membership.inviting import InvitationPlan
    from swarmctl.terminal.output import Output
    from swarmctl.terminal.quantities import span_s

    plan = InvitationPlan((platform,), role, span_s(valid), listen, file)
    add_node(Output(settings(ctx)), NewNode(platform, address, kind, template), plan, root_dir, hosts_file)


@cmd.command(nodes=Nodes.NONE)
@click.argument("platforms", nargs=-1, required=True, metavar="PLATFORM…", type=PLATFORM)
@root_option
@hosts_option
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option(
    "--force",
    is_flag=True,
    help="Also remove a node with a mission, an armed vehicle, or a node that does not answer.",
)
@timeout_option(15.0)
@click.pass_context
def remove(
    ctx: click.Context,
    platforms: tuple[str, ...],
    root_dir: Path | None,
    hosts_file: Path | None,
    yes: bool,
    force: bool,
    wait_s: float,
) -> None:
    """Remove nodes from the swarm: revoke their keys, and delete their data at all other nodes.

    Their own files and logs stay. A removal is refused while a mission runs there, and in a swarm without
    keys while the node runs.

    Example: swarmctl node remove uav4 --hosts HOSTS.toml --yes
    """
    from swarmctl.commands.node.removing import Removal
    from swarmctl.terminal.output import Output

    Removal(Output(settings(ctx)), platforms, root_dir, hosts_file).run(wait_s, yes=yes, force=force)


@cmd.command(nodes=Nodes.NONE)
@click.argument("platform", metavar="PLATFORM", type=PLATFORM)
@click.argument("new", metavar="NEW")
@click.option(
    "--token",
    type=TOKEN,
    default="",
    metavar="TOKEN",
    help="Token of `keys invite NEW`, if the root is not here; `-` reads it from stdin, @FILE from a file.",
)
@root_option
@hosts_option
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def rename(
    ctx: click.Context,
    platform: str,
    new: str,
    token: str,
    root_dir: Path | None,
    hosts_file: Path | None,
    yes: bool,
) -> None:
    """Give the node on this computer another name: its key is admitted with it; settings and logs stay.

    The node must be stopped. Older records keep the former name.

    Example: swarmctl node rename uav4 scout --yes
    """
    from swarmctl.commands.node.renaming import Renaming
    from swarmctl.terminal.output import Output

    Renaming(Output(settings(ctx)), platform, new).run(token, root_dir, hosts_file, yes=yes)
