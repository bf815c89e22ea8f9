"""`swarmctl video`: send a camera or recording as video; list, control and end what is sent."""

from pathlib import Path

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.parameters import at_path
from swarmctl.commandline.settings import Nodes, settings

SESSION = click.argument("session", type=click.IntRange(min=0))
PINNED = click.option("--pinned", is_flag=True, help="Keep this rate, whatever the link carries.")


@click.group(cls=Group)
def cmd() -> None:
    """Video of cameras and recordings: H.264 over RTP, to a platform or a standard receiver.

    Example: swarmctl video ls --node uav1
    """


@cmd.command(nodes=Nodes.ONE)
@click.argument("source")
@click.option("--to", required=True, metavar="RECEIVER", help="A platform, or HOST:PORT.")
@click.option(
    "--bitrate", default="2mbit", show_default=True, metavar="RATE", help="Highest rate: 1mbit, 500kbit."
)
@PINNED
@click.option("--sdp", metavar="FILE", type=click.Path(path_type=Path), help="Write the session description.")
@click.pass_context
def start(ctx: click.Context, source: str, to: str, bitrate: str, sdp: Path | None, pinned: bool) -> None:
    """Send a source of a node as video; without --pinned its rate follows the link.

    A platform publishes the images as a stream. For HOST:PORT the commands of standard receivers are printed.

    Example: swarmctl video start /uav1/camera --to gcs --bitrate 1mbit
    """
    from swarmctl.commands.video import sessions
    from swarmctl.session.session import run

    chosen, local = at_path(ctx, source)
    run(chosen, sessions.start, local, to, sessions.bitrate_bit_s(bitrate), pinned, sdp)


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the video sessions of platforms, sent and received: rates, queues, losses, last changes.

    Example: swarmctl video ls --node uav1
    """
    from swarmctl.commands.video.sessions import list_sessions
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), list_sessions)


@cmd.command(nodes=Nodes.ONE)
@SESSION
@click.argument("bitrate", metavar="RATE")
@PINNED
@click.pass_context
def rate(ctx: click.Context, session: int, bitrate: str, pinned: bool) -> None:
    """Set the highest rate of a session that a node sends, or pin its rate.

    Example: swarmctl video rate 3405691582 500kbit --pinned --node uav1
    """
    from swarmctl.commands.video import sessions
    from swarmctl.session.session import run

    run(settings(ctx), sessions.set_rate, session, sessions.bitrate_bit_s(bitrate), pinned)


@cmd.command(nodes=Nodes.ONE)
@SESSION
@click.pass_context
def stop(ctx: click.Context, session: int) -> None:
    """End a session of a node, sent or received; its number is in `video ls`.

    Example: swarmctl video stop 3405691582 --node uav1
    """
    from swarmctl.commands.video import sessions
    from swarmctl.session.session import run

    run(settings(ctx), sessions.stop, session)
