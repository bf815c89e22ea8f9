"""`swarmctl mission`: check, start, watch, queue and abort missions."""

from pathlib import Path

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM, at_nodes, nodes_argument
from swarmctl.commandline.settings import Nodes, settings

PRIORITIES = (0, 99)
"""Lowest and highest priority, as in `swarmware.mission.model`, whose import takes long."""


@click.group(cls=Group)
def cmd() -> None:
    """Check, start, watch and abort missions.

    Example: swarmctl mission start formation
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the missions in the store of a ground station.

    Example: swarmctl mission ls
    """
    from swarmctl.commands.mission.status import list_missions
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_missions)


@cmd.command(nodes=Nodes.NONE)
@click.argument(
    "missions", nargs=-1, required=True, metavar="FILE|FOLDER|NAME…", shell_complete=completion.missions
)
@click.pass_context
def check(ctx: click.Context, missions: tuple[str, ...]) -> None:
    """Check missions before anything moves: BDL files, mission folders, or names of shipped missions.

    Example: swarmctl mission check formation my_mission.json
    """
    from swarmctl.commands.mission.task import check_missions
    from swarmctl.terminal.output import Output

    check_missions(missions, Output(settings(ctx)))


@cmd.command("import", nodes=Nodes.NONE)
@click.argument("source", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    default=None,
    help="Folder of the mission, which must not exist; default: the name of the file.",
)
@click.option(
    "--origin",
    metavar="LAT LON",
    type=(click.FloatRange(-89.9, 89.9), click.FloatRange(-180, 180)),
    default=None,
    help="Origin of the map of the swarm, in degrees; default: the home position of the plan.",
)
@click.option("--skip-unsupported", is_flag=True, help="Leave out what a mission cannot do, with a warning.")
@click.pass_context
def import_(
    ctx: click.Context,
    source: Path,
    output: Path | None,
    origin: tuple[float, float] | None,
    skip_unsupported: bool,
) -> None:
    """Import a plan of QGroundControl (.plan) or a waypoints file (QGC WPL 110) as a mission.

    The mission is checked before it is written.

    Example: swarmctl mission import survey.plan --skip-unsupported -o survey
    """
    from swarmctl.commands.mission.plan_import import import_plan
    from swarmctl.terminal.output import Output

    import_plan(source, output, origin, Output(settings(ctx)), skip=skip_unsupported)


@cmd.command(nodes=Nodes.ONE)
@click.argument("mission", shell_complete=completion.missions)
@click.option(
    "--member",
    "members",
    multiple=True,
    metavar="PLATFORM",
    help="Platforms that take part, names or patterns; default: all.",
    type=PLATFORM,
)
@click.option("--set", "params", multiple=True, metavar="NAME=VALUE", help="Set a parameter of the mission.")
@click.option(
    "--priority",
    type=click.IntRange(*PRIORITIES),
    default=None,
    help="A mission of higher priority suspends one of lower priority; default: the priority in the mission.",
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation; vehicles will move.")
@click.option("--watch/--no-watch", default=False, help="Follow the mission until it ends.")
@click.pass_context
def start(
    ctx: click.Context,
    mission: str,
    members: tuple[str, ...],
    params: tuple[str, ...],
    priority: int | None,
    yes: bool,
    watch: bool,
) -> None:
    """Start a mission of the swarm, given by name, folder or file.

    It shows warnings of the check, the members, and known platforms without a role with the reason, then
    asks. On vehicles that play another mission it waits in their queues.

    Example: swarmctl mission start formation --set speed_m_s=1.0 --yes --watch
    """
    from swarmctl.commands.mission import start as starting
    from swarmctl.commands.mission.task import task
    from swarmctl.session.session import run

    what = task(mission, (), params, priority)
    run(settings(ctx), starting.start, mission, what, members, yes=yes, watch=watch)


@cmd.command()
@click.pass_context
def status(ctx: click.Context) -> None:
    """Show the mission state of a platform, and of the other members as received there.

    Example: swarmctl mission status --json
    """
    from swarmctl.commands.mission.status import print_status
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), print_status)


@cmd.command()
@click.pass_context
def queue(ctx: click.Context) -> None:
    """Show the missions of a platform in their order: running, waiting, suspended, and why.

    Example: swarmctl mission queue -n uav1
    """
    from swarmctl.commands.mission.queue import print_queue
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), print_queue)


@cmd.command()
@click.option(
    "--show", "run_id", type=click.IntRange(min=1), metavar="ID", help="Show this run, with its steps."
)
@click.pass_context
def history(ctx: click.Context, run_id: int | None) -> None:
    """List the runs that a platform has played, newest first, or show one of them.

    Example: swarmctl mission history --all
    """
    from swarmctl.commands.mission.history import print_history, print_run
    from swarmctl.session.each_node import run_each

    if run_id is None:
        run_each(settings(ctx), print_history)
    else:
        run_each(settings(ctx), print_run, run_id)


@cmd.command(nodes=Nodes.ONE)
@click.argument("run_id", metavar="ID", type=click.IntRange(min=1))
@click.option("--reason", default="cancelled by the operator", help="Reason, recorded in all logs.")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.pass_context
def cancel(ctx: click.Context, run_id: int, reason: str, yes: bool) -> None:
    """End a run at all its members, whether it waits, is suspended or is played.

    The vehicles that play it do what its `on_failure` says; on the others nothing moves.

    Example: swarmctl mission cancel 2754631902 --yes
    """
    from swarmctl.commands.mission import queue as queueing
    from swarmctl.session.session import run

    run(settings(ctx), queueing.cancel, run_id, reason, yes=yes)


@cmd.command(nodes=Nodes.ONE)
@click.argument("run_id", metavar="ID", type=click.IntRange(min=1))
@click.argument("priority", type=click.IntRange(*PRIORITIES))
@click.pass_context
def prioritize(ctx: click.Context, run_id: int, priority: int) -> None:
    """Change the priority of a run at all its members; it may then suspend another one.

    Example: swarmctl mission prioritize 2754631902 10
    """
    from swarmctl.commands.mission import queue as queueing
    from swarmctl.session.session import run

    run(settings(ctx), queueing.prioritize, run_id, priority)


@cmd.command()
@nodes_argument()
@click.option("--stop", is_flag=True, help="End the block with the error `stopped`.")
@click.option("--block", default="", help="Block that asks, where several blocks of a platform ask.")
@click.pass_context
def answer(ctx: click.Context, platforms: tuple[str, ...], stop: bool, block: str) -> None:
    """Continue a mission that waits for the operator at a UserBreakpoint, at one or several platforms.

    Example: swarmctl mission answer uav1
    """
    from swarmctl.commands.mission.answering import answer as answering
    from swarmctl.session.each_node import run_each

    run_each(at_nodes(ctx, platforms), answering, block, proceed=not stop)


@cmd.command()
@nodes_argument()
@click.pass_context
def watch(ctx: click.Context, platforms: tuple[str, ...]) -> None:
    """Follow a mission until it ends, at all its members or at the named members.

    On a terminal each member has one line, which is redrawn; elsewhere each change of state or block is a
    line with its time.

    Example: swarmctl mission watch --json
    """
    from swarmctl.commands.mission.members import watch
    from swarmctl.session.session import run

    run(settings(ctx), watch, platforms)


@cmd.command()
@nodes_argument()
@click.option("--reason", default="operator", help="Reason, recorded in all logs.")
@click.option(
    "--then",
    type=click.Choice(["land", "hold", "return"]),
    default="land",
    help="Built-in mission that follows.",
)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@click.option(
    "--timeout",
    "wait_s",
    metavar="SECONDS",
    type=click.FloatRange(min=0, min_open=True),
    default=120.0,
    help="Maximum wait until all have done it; default: 120.",
)
@click.pass_context
def abort(
    ctx: click.Context, platforms: tuple[str, ...], reason: str, then: str, yes: bool, wait_s: float
) -> None:
    """Stop the running mission at all its members, or only at the named ones (also by -n).

    The command follows the members until each has landed, holds or has returned.

    Example: swarmctl mission abort --then hold --yes
    """
    from swarmctl.commands.mission import abort as aborting
    from swarmctl.session.session import run

    run(settings(ctx), aborting.abort, platforms, reason, then, wait_s, yes=yes)
