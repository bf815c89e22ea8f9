"""`swarmctl keys`: keys of the swarm: its root, its members, and how a node becomes one."""

from pathlib import Path
from typing import Final

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM, root_option
from swarmctl.commandline.secret import TOKEN
from swarmctl.commandline.settings import Nodes, settings

read_root_option: Final = click.option(
    "--root",
    "root_dir",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Folder of a root whose roster is read instead of the node's.",
)


@click.group(cls=Group)
def cmd() -> None:
    """Keys of the swarm: make them, invite and revoke members, change the group key.

    Example: swarmctl keys invite uav1
    """


@cmd.command(nodes=Nodes.NONE)
@root_option
@click.option("--swarm", default="swarm", show_default=True, metavar="NAME", help="Name of the swarm.")
@click.option("--replace", is_flag=True, help="Give up the identity that the node has.")
@click.pass_context
def init(ctx: click.Context, root_dir: Path | None, swarm: str, replace: bool) -> None:
    """Make the root key of a new swarm, and the node on this computer its first member, a maintainer.

    The root key signs the members of the swarm. It is needed to invite, revoke and rotate; no node needs it
    to run.

    Example: swarmctl keys init --root /media/stick/root
    """
    from swarmctl.commands.keys.making import make_root
    from swarmctl.terminal.output import Output

    make_root(Output(settings(ctx)), root_dir, swarm, replace=replace)


@cmd.command(nodes=Nodes.NONE)
@click.argument("platforms", nargs=-1, required=True, metavar="PLATFORM…", type=PLATFORM)
@root_option
@click.option(
    "--role",
    type=click.Choice(["observer", "node", "operator", "maintainer"]),
    default="node",
    show_default=True,
    help="Rights of the nodes at the other platforms.",
)
@click.option("--valid", default="10m", show_default=True, metavar="TIME", help="30s, 10m, 2h: time to join.")
@click.option(
    "--address",
    default="",
    metavar="HOST[:PORT]",
    help="Address by which the nodes reach this computer; default: its addresses, TCP port 7449.",
)
@click.option(
    "--file",
    default="",
    metavar="FILE",
    type=click.Path(dir_okay=False),
    help="Write the credentials of one platform to a file, for a node without a network.",
)
@click.pass_context
def invite(
    ctx: click.Context,
    platforms: tuple[str, ...],
    root_dir: Path | None,
    role: str,
    valid: str,
    address: str,
    file: str,
) -> None:
    """Invite platforms: print the command that each node needs, and admit them until all have joined.

    A token admits one node, once, while this command runs. Ctrl-C ends it; nodes that have joined stay.

    Example: swarmctl keys invite uav1 uav2 --valid 30m
    """
    from swarmctl.membership.inviting import InvitationPlan, invite_nodes
    from swarmctl.terminal.output import Output
    from swarmctl.terminal.quantities import span_s

    plan = InvitationPlan(platforms, role, span_s(valid), address, file)
    invite_nodes(Output(settings(ctx)), root_dir, plan)


@cmd.command(nodes=Nodes.NONE)
@click.argument("token", type=TOKEN)
@click.option(
    "--file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="File of `keys invite --file`, for a node without a network.",
)
@click.option("--replace", is_flag=True, help="Give up the identity that the node has.")
@click.pass_context
def join(ctx: click.Context, token: str, file: Path | None, replace: bool) -> None:
    """Join a swarm: the node on this computer makes a key, and the inviter admits it.

    TOKEN is the word that `keys invite` printed, `-` to read it from stdin, or @FILE to read it from a file:
    other users of this computer see arguments. The secret key stays on this computer, except with --file.

    Example: swarmctl keys join 04m8xkw2
    """
    from swarmctl.membership.joining import join as join_swarm
    from swarmctl.terminal.output import Output

    join_swarm(Output(settings(ctx)), token, file, replace=replace)


@cmd.command(nodes=Nodes.NONE)
@read_root_option
@click.pass_context
def ls(ctx: click.Context, root_dir: Path | None) -> None:
    """List the members of the swarm and the revoked platforms, as the node on this computer knows them.

    With --root the roster of the root is listed.

    Example: swarmctl keys ls
    """
    from swarmctl.commands.keys.listing import list_members
    from swarmctl.terminal.output import Output

    list_members(Output(settings(ctx)), root_dir)


@cmd.command(nodes=Nodes.NONE)
@click.argument("platform", required=False, type=PLATFORM)
@read_root_option
@click.pass_context
def show(ctx: click.Context, platform: str | None, root_dir: Path | None) -> None:
    """Show a member: role, key, and the swarm's root; without a name the node on this computer.

    Example: swarmctl keys show uav1
    """
    from swarmctl.commands.keys.listing import show_member
    from swarmctl.terminal.output import Output

    show_member(Output(settings(ctx)), root_dir, platform or "")


@cmd.command(nodes=Nodes.NONE)
@click.argument("platforms", nargs=-1, required=True, metavar="PLATFORM…", type=PLATFORM)
@root_option
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def revoke(ctx: click.Context, platforms: tuple[str, ...], root_dir: Path | None, yes: bool) -> None:
    """Revoke members: the others refuse them, and change the group key, which the revoked members know.

    Example: swarmctl keys revoke uav1 --yes
    """
    from swarmctl.membership import changing
    from swarmctl.terminal.output import Output

    changing.revoke(Output(settings(ctx)), root_dir, platforms, yes=yes)


@cmd.command(nodes=Nodes.NONE)
@root_option
@click.pass_context
def rotate(ctx: click.Context, root_dir: Path | None) -> None:
    """Change the group key, with which the members seal their datagrams.

    Example: swarmctl keys rotate
    """
    from swarmctl.membership import changing
    from swarmctl.terminal.output import Output

    changing.rotate(Output(settings(ctx)), root_dir)
