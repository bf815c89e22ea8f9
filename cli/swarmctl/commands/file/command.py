"""`swarmctl file`: files to and from nodes."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from swarmctl.commandline.lazy import Group
from swarmctl.commandline.settings import Nodes, settings

if TYPE_CHECKING:
    from swarmctl.session.session import Session

GIVE_UP_S: Final = 60.0
_GIVE_UP: Final = click.option(
    "--give-up",
    "give_up_s",
    type=click.FloatRange(min=1),
    default=GIVE_UP_S,
    show_default=True,
    metavar="SECONDS",
    help="End without progress for this time.",
)


@click.group(cls=Group)
def cmd() -> None:
    """Send files to nodes that run the service `files`, and get them.

    Example: swarmctl file send map.png --node uav1
    """


@cmd.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--as", "name", default="", metavar="NAME", help="Name at the node; without it the file's own.")
@_GIVE_UP
@click.pass_context
def send(ctx: click.Context, file: Path, name: str, give_up_s: float) -> None:
    """Send a file; after an interruption the same command sends the missing blocks.

    Example: swarmctl file send map.png --node uav1
    """
    from swarmctl.commands.file.sending import send_file
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), send_file, file, name or file.name, give_up_s)


@cmd.command(nodes=Nodes.ONE)
@click.argument("name")
@click.option(
    "--to", "target", type=click.Path(path_type=Path), default=Path(), metavar="PATH", show_default="here",
    help="Folder or file where it is stored.",
)  # fmt: skip
@_GIVE_UP
@click.pass_context
def get(ctx: click.Context, name: str, target: Path, give_up_s: float) -> None:
    """Get a file; after an interruption the same command gets the missing blocks.

    Example: swarmctl file get map.png --node uav1 --to /tmp
    """
    from swarmctl.commands.file.getting import get_file
    from swarmctl.session.session import run

    run(settings(ctx), get_file, name, target, give_up_s)


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the files of nodes.

    Example: swarmctl file ls --node uav1
    """
    from swarmctl.session.each_node import run_each

    run_each(settings(ctx), _list_files)


async def _list_files(session: "Session") -> None:
    """Prints name, size and time of each."""
    from datetime import UTC, datetime

    from swarmctl.terminal.table import Column
    from swarmware.types.file import FileListing, FileQuery

    found = await session.ask("sys/files/list", FileQuery(), FileListing)
    if session.settings.structured:
        session.out.document(found)
        return
    rows = [
        (
            one.name,
            str(one.size_bytes),
            datetime.fromtimestamp(one.modified_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S"),
        )
        for one in found.files
    ]
    columns = [Column("NAME"), Column("BYTES", right=True), Column("MODIFIED UTC")]
    session.out.table(columns, rows, empty=f"{session.platform}: no files; {found.free_bytes} bytes are free")
