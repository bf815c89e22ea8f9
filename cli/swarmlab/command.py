"""`swarmctl lab`: a whole swarm of real processes on this machine."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import PLATFORM, at_nodes, nodes_argument
from swarmctl.commandline.secret import SECRET
from swarmctl.commandline.settings import Nodes, settings

EXPERIMENTS: Final = ("formation",)
DISTRIBUTION: Final = "distribution"
"""A mission with the services of a vehicle on one computer, and on three."""
NODES: Final = 16
NODES_OF_DISTRIBUTION: Final = 3
"""A ground station, a ground vehicle, and the air vehicle that is distributed."""


@click.group(cls=Group)
def cmd() -> None:
    """Run a whole swarm on this machine.

    Example: swarmctl lab run formation --nodes 4
    """


def _swarm_options(experiments: tuple[str, ...]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Options of `run` and `up`."""
    nodes = None if DISTRIBUTION in experiments else NODES
    default = f"{NODES}; {DISTRIBUTION}: {NODES_OF_DISTRIBUTION}" if nodes is None else True
    about = {
        "nodes": "Number of nodes: a ground station, and one ground vehicle for two air vehicles.",
        "usv": "Number of surface vessels among them.",
        "net": "loopback, or netns: a network namespace for each node, and a radio between them.",
        "radio": "Radio of --net netns: s3, lan, or the path of a radio file; default: s3.",
        "seed": "Seed of clocks, noise and start order.",
        "name": "Name of the lab; default: the experiment's.",
        "per_daemon": "Run each daemon in its own process, on all nodes or on those named (a,b).",
        "units": "Run the services of each vehicle, or of those named (a,b), on three computers.",
        "airframe": "Airframe of the air vehicles, or of those named: helicopter, uav1=fixed_wing.",
        "services": "Further services of every node: files, video, or an installed one.",
        "mongodb": "Forward all logs to this database as well; @FILE: the URI in a file, @-: from stdin.",
    }
    options = (
        click.argument("experiment", type=click.Choice(experiments)),
        click.option(
            "--nodes", type=int, default=nodes, show_default=default, metavar="N", help=about["nodes"]
        ),
        click.option("--usv", type=int, default=0, show_default=True, metavar="N", help=about["usv"]),
        click.option("--net", default="loopback", metavar="KIND", help=about["net"]),
        click.option("--radio", default="", metavar="NAME", help=about["radio"]),
        click.option("--seed", type=int, default=1, show_default=True, metavar="K", help=about["seed"]),
        click.option("--name", default="", metavar="NAME", help=about["name"]),
        click.option(
            "--per-daemon", is_flag=False, flag_value="all", metavar="[NAMES]", help=about["per_daemon"]
        ),
        click.option("--units", is_flag=False, flag_value="all", metavar="[NAMES]", help=about["units"]),
        click.option("--airframe", multiple=True, metavar="[NAMES=]AIRFRAME", help=about["airframe"]),
        click.option("--service", "services", multiple=True, metavar="NAME", help=about["services"]),
        click.option(
            "--mongodb", "mongodb_uri", type=SECRET, default="", metavar="URI", help=about["mongodb"]
        ),
    )

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            function = option(function)
        return function

    return add


@cmd.command(nodes=Nodes.NONE)
@_swarm_options((*EXPERIMENTS, DISTRIBUTION))
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=1),
    default=600.0,
    show_default=True,
    metavar="SECONDS",
    help="Time-out of the mission.",
)
@click.option(
    "--out",
    "out_dir",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Report folder; default: report/EXPERIMENT-NODES.",
)
@click.option("--strict", is_flag=True, help="Exit with 1 when a goal of the report is missed.")
@click.pass_context
def run(ctx: click.Context, /, duration_s: float, out_dir: Path | None, strict: bool, **spec: Any) -> None:
    """Start a swarm, run the experiment, stop it, write the report.

    `distribution` flies the mission twice, with the services of an air vehicle on one computer and on
    three with 2 to 8 ms delay between them, and compares the paths.

    Example: swarmctl lab run formation --nodes 16 --json
    """
    from swarmctl.terminal.output import Output
    from swarmlab import experiment
    from swarmlab.provision import prerequisites
    from swarmlab.provision.provisioning import LabSpec

    conduct = experiment.main
    distributed = spec["experiment"] == DISTRIBUTION
    if spec["nodes"] is None:
        spec["nodes"] = NODES_OF_DISTRIBUTION if distributed else NODES
    if distributed:
        prerequisites.require_modules("lab run", prerequisites.REPORT)
        from swarmlab import distribution

        conduct = distribution.main
    out = out_dir or Path("report") / f"{spec['experiment']}-{spec['nodes']}"
    ctx.exit(conduct(LabSpec(**spec), duration_s, out, Output(settings(ctx)), strict=strict))


@cmd.command(nodes=Nodes.NONE)
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--markdown", is_flag=True, help="Print the table in Markdown, without computing the report.")
@click.option("--strict", is_flag=True, help="Exit with 1 when a goal is missed.")
@click.pass_context
def report(ctx: click.Context, folder: Path, markdown: bool, strict: bool) -> None:
    """Compute the report of an earlier run again, from its logs.

    Example: swarmctl lab report report/formation-16 --markdown
    """
    from swarmctl.terminal.output import Output
    from swarmlab import experiment

    if markdown:
        experiment.page_table(folder, Output(settings(ctx)))
        return
    ctx.exit(experiment.report(folder, Output(settings(ctx)), strict=strict))


@cmd.command(nodes=Nodes.NONE)
@_swarm_options(EXPERIMENTS)
@click.option("--detach", is_flag=True, help="Return when the swarm is up; `lab down` ends it.")
@click.pass_context
def up(ctx: click.Context, /, detach: bool, **spec: Any) -> None:
    """Start a swarm and keep it running.

    Example: swarmctl lab up formation --nodes 6 --detach
    """
    from swarmctl.terminal.output import Output
    from swarmlab.provision.provisioning import LabSpec
    from swarmlab.run import lifecycle

    lifecycle.main(LabSpec(**spec), Output(settings(ctx)), detach=detach)


@cmd.command(nodes=Nodes.NONE)
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the labs of this user.

    Example: swarmctl lab ls
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run.listing import list_labs

    list_labs(Output(settings(ctx)))


@cmd.command(nodes=Nodes.NONE)
@click.argument("platform", shell_complete=lambda ctx, param, word: completion.platforms(word))
@click.pass_context
def env(ctx: click.Context, platform: str) -> None:
    """Print the variable by which modules, swarmd and swarmctl join a node of a lab.

    Example: eval "$(swarmctl lab env uav1)"
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run.listing import print_environment

    print_environment(platform, Output(settings(ctx)))


@cmd.command()
@nodes_argument()
@click.option("--follow", "-f", is_flag=True, help="Follow new lines.")
@click.option("--lines", type=click.IntRange(min=1), default=20, show_default=True, help="Lines per node.")
@click.pass_context
def logs(ctx: click.Context, platforms: tuple[str, ...], follow: bool, lines: int) -> None:
    """Show the output of the processes of a lab, or of its nodes that are named.

    Example: swarmctl lab logs uav1 --follow
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run.listing import print_logs

    print_logs(lines, Output(at_nodes(ctx, platforms)), follow=follow)


_ONE_WAY: Final = click.option("--one-way", is_flag=True, help="Only from the first node to the second.")


@cmd.command(nodes=Nodes.NONE)
@click.argument("one", metavar="[NODE]", type=PLATFORM, required=False)
@click.argument("other", metavar="[NODE]", type=PLATFORM, required=False)
@click.option("--loss", metavar="PERCENT", help="Loss of frames: 0 to 100.")
@click.option("--delay", metavar="TIME", help="Additional delay: 50ms, 1s.")
@click.option("--jitter", metavar="TIME", help="Additional random delay: 0 to this.")
@click.option("--rate", metavar="RATE", help="Limit of the rate: 1mbit, 250kbit, or auto.")
@_ONE_WAY
@click.pass_context
def link(
    ctx: click.Context,
    one: str | None,
    other: str | None,
    loss: str | None,
    delay: str | None,
    jitter: str | None,
    rate: str | None,
    one_way: bool,
) -> None:
    """Impair links of a running lab with a radio; without options show their state and counters.

    The impairment is added to the effects of the radio. Nodes are names or patterns: one name selects all
    links of the node, and no name all links.

    Example: swarmctl lab link uav1 uav2 --loss 30 --delay 50ms --rate 1mbit
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run import links

    change = links.change(loss, delay, jitter, rate)
    links.impair(one or "", other or "", change, Output(settings(ctx)), one_way=one_way)


@cmd.command(nodes=Nodes.NONE)
@click.argument("one", metavar="NODE", type=PLATFORM)
@click.argument("other", metavar="[NODE]", type=PLATFORM, required=False)
@_ONE_WAY
@click.pass_context
def cut(ctx: click.Context, one: str, other: str | None, one_way: bool) -> None:
    """Cut links of a running lab with a radio: between two nodes, or all of one node.

    Example: swarmctl lab cut uav1 gcs
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run import links

    links.cut(one, other or "", Output(settings(ctx)), one_way=one_way)


@cmd.command(nodes=Nodes.NONE)
@click.argument("one", metavar="[NODE]", type=PLATFORM, required=False)
@click.argument("other", metavar="[NODE]", type=PLATFORM, required=False)
@click.pass_context
def heal(ctx: click.Context, one: str | None, other: str | None) -> None:
    """Remove cuts and impairments of all links, of the links of a node, or between two nodes.

    Example: swarmctl lab heal
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run import links

    links.heal(one or "", other or "", Output(settings(ctx)))


@cmd.command(nodes=Nodes.NONE)
@click.argument("groups", nargs=-1, required=True, metavar="NODE,NODE…", type=PLATFORM)
@click.pass_context
def partition(ctx: click.Context, groups: tuple[str, ...]) -> None:
    """Cut all links between groups of nodes; the nodes that are not named are one more group.

    Example: swarmctl lab partition uav1,uav2 uav3,gcs
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run import links

    links.partition(groups, Output(settings(ctx)))


@cmd.command(nodes=Nodes.NONE)
@click.argument("name", default="")
@click.option("--all", "everything", is_flag=True, help="All labs of this user.")
@click.option("--keep", is_flag=True, help="Keep configuration and logs.")
@click.pass_context
def down(ctx: click.Context, name: str, everything: bool, keep: bool) -> None:
    """End a lab and remove its files; without a name the newest one.

    Example: swarmctl lab down
    """
    from swarmctl.terminal.output import Output
    from swarmlab.run.lifecycle import end_labs

    end_labs(name, Output(settings(ctx)), everything=everything, keep=keep)
