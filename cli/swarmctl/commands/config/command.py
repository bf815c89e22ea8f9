"""`swarmctl config`: settings of the nodes."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Settings of the nodes, and their origin.

    A setting has a key SERVICE/NAME, here with its meaning, default, origin and history. Keys of
    configuration files are shown too; live settings can be changed. For values of any other resource use
    `tree get` and `tree set`.

    Example: swarmctl config get --node uav1
    """


@cmd.command()
@click.argument("key", default="**", shell_complete=completion.config_keys)
@click.option("--changed", is_flag=True, help="Only values that differ from the defaults.")
@click.pass_context
def get(ctx: click.Context, key: str, changed: bool) -> None:
    """Print the value in force of a key, or all keys that match a pattern, with their origin.

    For poses, states and other measured values use `tree get`.

    Example: swarmctl config get 'navigator/*' --node uav1
    """
    from swarmctl.commands.config.keys import print_keys
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), print_keys, key, changed=changed)


@cmd.command()
@click.argument("keys", nargs=-1, required=True, metavar="KEY...", shell_complete=completion.config_keys)
@click.pass_context
def describe(ctx: click.Context, keys: tuple[str, ...]) -> None:
    """Describe keys: meaning, type, unit, range, default, origin and how to change them.

    Example: swarmctl config describe navigator/altitude_kp --node uav1
    """
    from swarmctl.commands.config.keys import describe as describe_keys
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), describe_keys, keys)


@cmd.command()
@click.argument("key", default="", shell_complete=completion.config_keys)
@click.option("--changed", is_flag=True, help="Only values that differ from the defaults.")
@click.pass_context
def show(ctx: click.Context, key: str, changed: bool) -> None:
    """Check the files of a node on this machine, which need not run, and print the keys.

    Example: swarmctl config show broker
    """
    from swarmctl.commands.config.keys import print_local
    from swarmctl.terminal.output import Output

    chosen = settings(ctx)
    print_local(chosen, key, Output(chosen), changed=changed)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("key", shell_complete=completion.live_settings)
@click.argument("value", required=False, shell_complete=completion.setting_values)
@click.option("--default", is_flag=True, help="Return to the value of the file: remove the override.")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def set_(ctx: click.Context, key: str, value: str | None, default: bool, yes: bool) -> None:
    """Set a live setting of a platform; it is checked, stored, and takes effect at once.

    For other resources use `tree set`, and for the rate at which values are sent `traffic set`.

    Example: swarmctl config set navigator/altitude_kp 1.5 --node uav1
    """
    from swarmctl.commands.config.changes import reset_setting, set_setting
    from swarmctl.session.each_node import run_each

    if default == (value is not None):
        raise click.UsageError("expected either VALUE or --default")
    if value is None:
        run_each(settings(ctx), reset_setting, key, yes=yes)
    else:
        run_each(settings(ctx), set_setting, key, value, yes=yes)


@cmd.command()
@click.argument("key", shell_complete=completion.live_settings)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def undo(ctx: click.Context, key: str, yes: bool) -> None:
    """Undo the last change of a live setting; a second call restores it.

    Example: swarmctl config undo navigator/altitude_kp --node uav1
    """
    from swarmctl.commands.config.changes import undo_setting
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), undo_setting, key, yes=yes)


@cmd.command()
@click.argument("key", default="**", shell_complete=completion.live_settings)
@click.pass_context
def history(ctx: click.Context, key: str) -> None:
    """Print the changes of a live setting: user, time, former and new value; the newest change first.

    Example: swarmctl config history navigator/altitude_kp --node uav1
    """
    from swarmctl.commands.config.changes import print_history
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), print_history, key)


@cmd.command()
@click.argument("file", default="", metavar="[FILE]")
@click.option("--files", is_flag=True, help="With the keys of configuration files.")
@click.pass_context
def dump(ctx: click.Context, file: str, files: bool) -> None:
    """Print the live settings of a platform as TOML, or write them to a file for `config load`.

    For several platforms FILE is a folder, `NAME/`, with a file for each.

    Example: swarmctl config dump uav1.toml --node uav1
    """
    from swarmctl.commands.config import transfer
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), transfer.dump, file, files=files)


@cmd.command()
@click.argument("file", metavar="FILE")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def load(ctx: click.Context, file: str, yes: bool) -> None:
    """Set the live settings of a file, all or none, and print what changed.

    All values are checked before the first is set, and a refusal undoes the others. Each of several platforms
    gets the values of the file, or of its own file in a folder, `NAME/`.

    Example: swarmctl config load uav1.toml --node uav2
    """
    from swarmctl.commands.config import transfer
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), transfer.load, file, yes=yes)


@cmd.command()
@click.argument("other", default="", metavar="[FILE|PLATFORM]")
@click.option("--files", is_flag=True, help="With the keys of configuration files.")
@click.pass_context
def diff(ctx: click.Context, other: str, files: bool) -> None:
    """Print settings that differ from a file or another platform, by default from the platform's own files.

    Example: swarmctl config diff uav1 --node uav2
    """
    from swarmctl.commands.config import transfer
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), transfer.diff, other, files=files)
