"""`swarmctl docs`: the documentation in a browser."""

import click
from click.shell_completion import CompletionItem

from swarmctl.commandline.lazy import Command
from swarmctl.commandline.settings import Nodes, settings


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from swarmctl.commands.docs.site import page_names
    from swarmware.errors import SwarmError

    try:
        return [CompletionItem(name) for name in page_names() if name.startswith(incomplete)]
    except SwarmError:
        return []  # nothing to complete where the documentation was not built


@click.command(cls=Command, nodes=Nodes.NONE)
@click.argument("page", default="index", shell_complete=_complete)
@click.option("--path", "only_path", is_flag=True, help="Print the path of the page and open nothing.")
@click.pass_context
def cmd(ctx: click.Context, page: str, only_path: bool) -> None:
    """Open the documentation of this installation in a browser, at its first page or at PAGE.

    Example: swarmctl docs cli
    """
    from swarmctl.commands.docs.site import show_page
    from swarmctl.terminal.output import Output

    show_page(page, Output(settings(ctx)), only_path=only_path)
