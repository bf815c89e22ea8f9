"""`swarmctl host`: sets this computer up for a node under systemd, and removes it."""

from typing import Any

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM
from swarmctl.commandline.settings import Nodes, settings


@click.group(cls=Group)
def cmd() -> None:
    """Set this computer up for a node under systemd, or remove it; needs root.

    Example: swarmctl host install --name uav1
    """


class LoginName(click.ParamType):  # type: ignore[type-arg]  # 8.1 is not generic
    """A user of this computer."""

    name = "user"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Users with a home below /home."""
        import pwd

        from click.shell_completion import CompletionItem

        people = [one.pw_name for one in pwd.getpwall() if one.pw_dir.startswith("/home/")]
        return [CompletionItem(name) for name in sorted(people) if name.startswith(incomplete)]


@cmd.command(nodes=Nodes.NONE)
@click.option("--name", default=None, type=PLATFORM, metavar="PLATFORM", help="Name of the platform: uav1.")
@click.option(
    "--kind",
    type=click.Choice(["uav", "ugv", "usv", "gcs"]),
    default=None,
    help="Kind of the platform; default: the letters with which its name begins.",
)
@click.option(
    "--template", default="", metavar="NAME", help="Resource template; by default the template of the kind."
)
@click.option(
    "--unit",
    default="",
    metavar="NAME",
    help="Name of this computer, where the platform has several; default: main.",
)
@click.option("--real", is_flag=True, help="Set up a real vehicle, without the simulated one.")
@click.option(
    "--single-unit", is_flag=True, help="One unit of systemd for the node; default: one for each service."
)
@click.option(
    "--operator",
    "operators",
    type=LoginName(),
    multiple=True,
    metavar="USER",
    help="User who may operate the node: becomes a member of group swarm. Several add up.",
)
@click.option("--no-start", is_flag=True, help="Do not start the node now; it starts at the next boot.")
@click.option("--dry-run", is_flag=True, help="Print the steps, and change nothing.")
@click.pass_context
def install(
    ctx: click.Context,
    /,
    name: str | None,
    kind: str | None,
    template: str,
    unit: str,
    real: bool,
    single_unit: bool,
    operators: tuple[str, ...],
    no_start: bool,
    dry_run: bool,
) -> None:
    """Set this computer up for a node, and start it: user, folders, configuration, units of systemd.

    It does only the missing steps, so it can be repeated after an upgrade, a change of `services` in
    node.toml, or a restored backup. A configuration file that exists is not changed.

    Example: swarmctl host install --name uav1 --operator anna
    """
    from swarmctl.commands.host.installing import install_node
    from swarmctl.installation.configuration import NodeChoice
    from swarmctl.terminal.output import Output

    choice = NodeChoice(name or "", kind or "", template, real, single_unit, unit)
    install_node(Output(settings(ctx)), choice, operators, start=not no_start, dry_run=dry_run)


@cmd.command(nodes=Nodes.NONE)
@click.option("--purge", is_flag=True, help="Remove configuration, keys, settings, logs and user, too.")
@click.option("--force", is_flag=True, help="Also an armed vehicle, and a node that does not answer.")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option("--dry-run", is_flag=True, help="Print the steps, and change nothing.")
@click.pass_context
def uninstall(ctx: click.Context, purge: bool, force: bool, yes: bool, dry_run: bool) -> None:
    """Stop the node, and remove everything that `host install` set up.

    Configuration, keys and data stay without --purge. The environment with the programs, a folder, stays.

    Example: swarmctl host uninstall --yes
    """
    from swarmctl.commands.host.removing import remove_node
    from swarmctl.terminal.output import Output

    remove_node(Output(settings(ctx)), purge=purge, force=force, yes=yes, dry_run=dry_run)
