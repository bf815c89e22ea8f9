"""Runs a command at each selected node, concurrently, and prints one result."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Concatenate, ParamSpec, TypeVar

from swarmctl.commandline.nodes import NodeSelection, is_selection
from swarmctl.commandline.settings import CliSettings
from swarmctl.session.session import Session, connect
from swarmctl.terminal.confirmation import JointConfirmation
from swarmctl.terminal.node_output import NodeOutput, print_results, raise_errors
from swarmware.errors import NotFound, SwarmError

P = ParamSpec("P")
T = TypeVar("T")


class ResourceAbsent(NotFound):
    """Absence of a resource at one of several nodes, which a pattern of nodes then leaves out."""


async def at_each(
    session: Session,
    command: Callable[Concatenate[Session, P], Awaitable[T]],
    *args: P.args,
    **kwargs: P.kwargs,
) -> None:
    """Calls `command` for each selected node, or directly if the selection is a single name.

    A node without the resource is left out if only a pattern selects it and another node has the resource.
    Raises: NotFound when a name or a pattern matches no node; Partial when the command failed at some
    nodes; the node's own error for a single node.
    """
    if not is_selection(session.settings.node):
        await command(session, *args, **kwargs)
        return
    selection = NodeSelection(session.settings.node)
    nodes = selection.choose(await session.platforms(), session.here)
    joint = JointConfirmation(nodes)
    outputs = {name: NodeOutput(name, session.out) for name in nodes}
    errors: dict[str, SwarmError] = {}

    async def one(name: str) -> None:
        try:
            await command(session.at(name, outputs[name], joint), *args, **kwargs)
        except SwarmError as error:
            errors[name] = error
        except BaseException as error:
            # the others wait for this node's part of the common question: without it they never end
            joint.fail(error)
            raise
        joint.finish(name)

    # no TaskGroup: the failure of one node must not cancel the command at the others
    ended = await asyncio.gather(*(one(name) for name in nodes), return_exceptions=True)
    for error in ended:
        if isinstance(error, BaseException):
            raise error
    absent = [
        name
        for name in nodes
        if isinstance(errors.get(name), ResourceAbsent) and not selection.has_name(name)
    ]
    # if all lack the resource, the path is probably mistyped, and each error is shown
    if absent and len(absent) < len(nodes):
        nodes = [name for name in nodes if name not in absent]
        outputs = {name: outputs[name] for name in nodes}
        session.out.say(f"left out, without such a resource: {', '.join(absent)}")
    failed = {name: errors[name] for name in nodes if name in errors}
    print_results(session.out, outputs, failed)
    raise_errors(len(nodes), failed)


def run_each(
    settings: CliSettings,
    command: Callable[Concatenate[Session, P], Awaitable[T]],
    *args: P.args,
    **kwargs: P.kwargs,
) -> None:
    """Joins the node, calls `command(session, …)` for each selected node, and leaves the node."""

    async def main() -> None:
        async with connect(settings) as session:
            await at_each(session, command, *args, **kwargs)

    asyncio.run(main())
