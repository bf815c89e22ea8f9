"""`swarmctl tree`: resources: list, read, set and watch them."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.completion_cache import VALUED
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_path, at_pattern
from swarmctl.commandline.settings import Nodes, settings

FIELDS = click.option(
    "--field",
    "names",
    multiple=True,
    metavar="NAME",
    shell_complete=completion.field_names,
    help="Field of the value to show; may be repeated.",
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

    Settings are resources too, below `config/`; `swarmctl config` shows them with default, origin and
    meaning.

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
@click.option(
    "--watch", is_flag=True, help="Draw the tree again each second, with ages and rates; Ctrl-C ends it."
)
@click.option(
    "--count", type=click.IntRange(min=1), metavar="N", help="Number of drawings after which --watch ends."
)
@click.pass_context
def show(ctx: click.Context, pattern: str, watch: bool, count: int | None) -> None:
    """Draw the tree of resources.

    Example: swarmctl tree show /uav1/nav --watch
    """
    from swarmctl.commands.tree.listing import draw_resources, watch_resources
    from swarmctl.session.session import run

    if count is not None and not watch:
        raise click.UsageError("--count N ends --watch; expected both")
    if watch:
        run(settings(ctx), watch_resources, pattern, count)
    else:
        run(settings(ctx), draw_resources, pattern)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED, fields=True))
@FIELDS
@click.option("--fresh", is_flag=True, help="Query the owner even if there is a fresh mirror.")
@click.pass_context
def get(ctx: click.Context, path: str, names: tuple[str, ...], fresh: bool) -> None:
    """Print the newest value of a resource or of its fields, with time (UTC, by the clock of this machine),
    age and measured rate; a pattern prints the values of all resources that match.

    For a setting, `config get` also shows the origin.

    Example: swarmctl tree get /uav1/nav/pose.x_m
    """
    from swarmctl.commands.tree.reading import print_values
    from swarmctl.session.session import run

    run(settings(ctx), print_values, path, names=names, fresh=fresh)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources(VALUED | {"command"}, "w", fields=True))
@click.argument("value", shell_complete=completion.values)
@click.option(
    "--version",
    "--if-version",
    "version",
    type=int,
    metavar="N",
    help="Set the resource only if it still has this version, which `tree get --json` shows.",
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation, such as for arming.")
@click.pass_context
def set_(ctx: click.Context, path: str, value: str, version: int | None, yes: bool) -> None:
    """Set a resource, or one of its fields; the owner checks type, range and permission.

    A confirmation is needed if the template of the resource requires one. A pattern such as
    '/uav*/config/navigator/altitude_kp' sets several platforms at the same time. For settings, `config set`
    does the same with their keys.

    Example: swarmctl tree set /uav1/config/navigator/altitude_kp 1.5
    """
    from swarmctl.resources.access import set_resource
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, path)
    run_each(chosen, set_resource, local, value, version=version, yes=yes)


@cmd.command()
@click.argument("path", shell_complete=completion.resources({"setting"}, "w"))
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def undo(ctx: click.Context, path: str, yes: bool) -> None:
    """Undo the last change of a setting; a second call restores it.

    A pattern of nodes leaves out nodes without the setting.

    Example: swarmctl tree undo /uav1/config/navigator/altitude_kp
    """
    from swarmctl.resources.undoing import undo_resource
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, path)
    run_each(chosen, undo_resource, local, yes=yes)


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"command"}, "w"))
@click.option("--by", default="", metavar="NAME", help="Only changes by requesters whose name contains NAME.")
@click.option("--since", default="", metavar="TIME", help="Only changes of the last 30s, 5m, 2h or 1d.")
@click.option("--refused", is_flag=True, help="Only changes that were refused.")
@click.option(
    "--count",
    type=click.IntRange(1, 500),
    default=20,
    metavar="N",
    help="Number of changes to print, the newest; default: 20.",
)
@click.pass_context
def log(ctx: click.Context, pattern: str, by: str, since: str, refused: bool, count: int) -> None:
    """Print changes of resources: requester, time, former and new value, and refusals.

    Example: swarmctl tree log '/*/config/**' --since 1h
    """
    from swarmctl.commands.tree.change_log import print_log
    from swarmctl.session.each_node import run_each

    chosen, local = at_pattern(ctx, pattern)
    run_each(chosen, print_log, local, by=by, since=since, refused=refused, count=count)


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED))
@click.option(
    "--deadband",
    type=click.FloatRange(min=0),
    metavar="X",
    help="Notify only when a number differs by more than X.",
)
@click.option(
    "--min-interval",
    default="",
    metavar="TIME",
    help="Minimum time between notifications, such as 500ms, 2s or 1m.",
)
@click.option(
    "--max-interval", default="", metavar="TIME", help="Time after which an unchanged value is sent again."
)
@click.option("--reset", is_flag=True, help="Remove the rule of this pattern.")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def rule(
    ctx: click.Context,
    pattern: str,
    deadband: float | None,
    min_interval: str,
    max_interval: str,
    reset: bool,
    yes: bool,
) -> None:
    """Set the rule by which a platform notifies its subscribers; without an option print the rules in force.

    A rule is stored at the platform, holds for all its subscribers and replaces their own rules. A rate of
    `traffic set` has precedence over the minimum interval; `traffic channels` shows the rule in force.

    Example: swarmctl tree rule '/*/power/**' --deadband 0.5 --min-interval 2s
    """
    from swarmctl.commands.tree.rules import set_rule
    from swarmctl.session.each_node import run_each

    changes = deadband is not None or min_interval or max_interval
    if reset and changes:
        raise click.UsageError("--reset removes the rule; expected it alone")
    chosen, local = at_pattern(ctx, pattern)
    run_each(
        chosen,
        set_rule,
        local,
        deadband=deadband,
        min_interval=min_interval,
        max_interval=max_interval,
        reset=reset,
        yes=yes,
    )


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"branch", "command"}))
@click.option(
    "--file", default="", metavar="FILE", help="File to write: TOML, or JSON if its name ends in .json."
)
@click.pass_context
def dump(ctx: click.Context, pattern: str, file: str) -> None:
    """Print structure and values of a platform or a pattern as TOML, or write them to a file.

    Example: swarmctl tree dump /uav1 --file uav1.toml
    """
    from swarmctl.commands.tree.snapshot import dump as dump_tree
    from swarmctl.session.session import run

    run(settings(ctx), dump_tree, pattern, file)


@cmd.command()
@click.argument("file", metavar="FILE")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def load(ctx: click.Context, file: str, yes: bool) -> None:
    """Set the settings in a dump to its values, all or none; with -n at other platforms than the dumped one.

    All values are checked before the first is set, and a refusal undoes the others. Boards and commands are
    left alone, because boards are measurements and commands move vehicles.

    Example: swarmctl tree load uav1.toml -n uav2
    """
    from swarmctl.commands.tree.snapshot import load as load_tree
    from swarmctl.session.session import run

    run(settings(ctx), load_tree, file, yes=yes)


@cmd.command(nodes=Nodes.NONE)
@click.argument("one", metavar="FILE|PLATFORM|PATTERN")
@click.argument("other", default="", metavar="[FILE|PLATFORM|PATTERN]")
@click.option("--values", is_flag=True, help="Compare all values, not only the values of settings.")
@click.pass_context
def diff(ctx: click.Context, one: str, other: str, values: bool) -> None:
    """Print the differences of two dumps, a dump and the present tree, or two platforms.

    Example: swarmctl tree diff uav1 uav2
    """
    from swarmctl.commands.tree.comparison import diff as diff_trees
    from swarmctl.session.session import run

    run(settings(ctx), diff_trees, one, other, values=values)


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"branch", "command"}))
@click.option(
    "--templates", is_flag=True, help="Check only the templates of this installation, without a node."
)
@click.pass_context
def lint(ctx: click.Context, pattern: str, templates: bool) -> None:
    """Check templates and the live tree: units, ranges, types, names, owners, contradictions of platforms.

    With a pattern, only matching resources of the live tree are checked.

    Example: swarmctl tree lint '/*/config/**'
    """
    from swarmctl.commands.tree import lint as checks
    from swarmctl.session.session import run
    from swarmctl.terminal.output import Output
    from swarmware.model.config import share_dir

    folder = share_dir() / "templates"
    if templates and pattern:
        raise click.UsageError("--templates or PATTERN, not both")
    if templates:
        checks.show(Output(settings(ctx)), *checks.template_findings(folder))
    else:
        run(settings(ctx), checks.lint_live, pattern, None if pattern else folder)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED, fields=True))
@FIELDS
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N values.")
@click.option(
    "--history",
    is_flag=True,
    help="Show also former values of boards, such as values that a buffer (traffic set --buffer) kept during "
    "an outage; they come after newer ones.",
)
@click.pass_context
def watch(ctx: click.Context, path: str, names: tuple[str, ...], count: int | None, history: bool) -> None:
    """Print each new value of a resource, of its fields, or of all that match, with time (UTC, by the clock
    of this machine), age at the arrival and rate of the arrivals; Ctrl-C ends it.

    Example: swarmctl tree watch /uav1/nav/pose --count 10 --json
    """
    from swarmctl.commands.tree.watching import print_changes
    from swarmctl.session.session import run

    run(settings(ctx), print_changes, path, count, names, history)


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
    """Measure the rates at which the owner writes a resource (by the counter in its values) and at which it
    arrives here, and the times between arrivals.

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
    """Measure the delay from the stamps of values to their arrival here, by converted clocks, with the error
    bound of the conversion.

    Example: swarmctl tree delay '/*/nav/pose'
    """
    from swarmctl.commands.tree.measuring import print_delays
    from swarmctl.session.session import run

    run(settings(ctx), print_delays, path, window_s)
