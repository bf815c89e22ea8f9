"""`swarmctl config`: settings of the nodes."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings
from swarmware.model import paths


@click.group(cls=Group)
def cmd() -> None:
    """Settings of the nodes: configuration files, and live settings, which are resources of the tree.

    Example: swarmctl config get --node uav1
    """


@cmd.command()
@click.argument("service", default="")
@click.option("--changed", is_flag=True, help="Only values that differ from the defaults.")
@click.pass_context
def show(ctx: click.Context, service: str, changed: bool) -> None:
    """Show the configuration files of a node on this machine: each key, its value and its origin.

    Example: swarmctl config show broker
    """
    from swarmctl.commands.config.effective import print_effective
    from swarmctl.terminal.output import Output

    chosen = settings(ctx)
    print_effective(chosen, service, Output(chosen), changed=changed)


@cmd.command()
@click.argument("key", default="**", shell_complete=completion.live_settings)
@click.pass_context
def get(ctx: click.Context, key: str) -> None:
    """Print a live setting of a platform, or all that match a pattern.

    Example: swarmctl config get navigator/altitude_kp --node uav1
    """
    from swarmctl.commands.config.live import print_settings
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), print_settings, key)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("key", shell_complete=completion.live_settings)
@click.argument("value")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def set_(ctx: click.Context, key: str, value: str, yes: bool) -> None:
    """Set a live setting of a platform; it is checked, stored, and takes effect at once.

    Example: swarmctl config set navigator/altitude_kp 1.5 --node uav1
    """
    from swarmctl.resources.access import set_resource
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), set_resource, paths.setting(key), value, version=None, yes=yes)


@cmd.command()
@click.argument("key", shell_complete=completion.live_settings)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def undo(ctx: click.Context, key: str, yes: bool) -> None:
    """Undo the last change of a live setting; a second call restores it.

    Example: swarmctl config undo navigator/altitude_kp --node uav1
    """
    from swarmctl.commands.config.live import undo_setting
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), undo_setting, key, yes=yes)


@cmd.command()
@click.argument("file", default="", metavar="[FILE]")
@click.pass_context
def dump(ctx: click.Context, file: str) -> None:
    """Print the live settings of a platform as TOML, or write them to a file for `config load`.

    Of several platforms FILE is a folder, `NAME/`, with a file for each.

    Example: swarmctl config dump uav1.toml --node uav1
    """
    from swarmctl.commands.config import transfer
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), transfer.dump, file)


@cmd.command()
@click.argument("file", metavar="FILE")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def load(ctx: click.Context, file: str, yes: bool) -> None:
    """Set the live settings of a file, all or none, and print what changed.

    All values are checked before one is set; when one is refused the others are taken back. Each of several
    platforms gets the values of the file, or of its own file in a folder, `NAME/`.

    Example: swarmctl config load uav1.toml --node uav2
    """
    from swarmctl.commands.config import transfer
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), transfer.load, file, yes=yes)


@cmd.command()
@click.argument("other", metavar="FILE|PLATFORM")
@click.pass_context
def diff(ctx: click.Context, other: str) -> None:
    """Print the live settings of a platform that differ from those of a file or of another platform.

    Example: swarmctl config diff uav1 --node uav2
    """
    from swarmctl.commands.config import transfer
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), transfer.diff, other)
