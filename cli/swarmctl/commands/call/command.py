"""`swarmctl call`: send a request and print the answer."""

import click

from swarmctl.commandline import completion
from swarmctl.commandline.lazy import Command
from swarmctl.commandline.parameters import at_path


@click.command(cls=Command, context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources({"command"}, "w"))
@click.argument("value", nargs=-1, metavar="[VALUE]…", shell_complete=completion.field_values)
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation, such as for arming.")
@click.pass_context
def call(ctx: click.Context, path: str, value: tuple[str, ...], yes: bool) -> None:
    """Send a request to a command of a module or daemon, and print the answer. A command without an answer
    gets a message, and its receiver is printed.

    VALUE is JSON, one plain word, or a word field=value for each field; `swarmctl tree type PATH` shows them.
    A confirmation is needed if the template of the resource requires one.

    Example: swarmctl call /uav1/sys/tree/get path=nav/pose
    """
    from swarmctl.commands.call.request import call_resource
    from swarmctl.session.each_node import run_each

    chosen, local = at_path(ctx, path)
    run_each(chosen, call_resource, local, value, yes=yes)
