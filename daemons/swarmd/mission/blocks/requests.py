"""Blocks that ask modules or the operator: requests, values of resources, services, breakpoints."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final, NamedTuple

import msgspec

from swarmd.mission.blocks.context import Context, spec
from swarmware.errors import InvalidInput, NoAnswer, NotFound, SwarmError
from swarmware.mission import resource_params
from swarmware.mission.condition_parser import parse as parse_condition
from swarmware.mission.plugin import BlockError
from swarmware.mission.resource_params import VALUE
from swarmware.mission.sensor_choice import SingleValue
from swarmware.model.names import join, split
from swarmware.model.resource import Kind
from swarmware.module.module import Module
from swarmware.types import registry
from swarmware.types.description import TypeDescription
from swarmware.types.health import GuardStatus, ServiceState, StartOrder, StopOrder
from swarmware.types.mission import ASKS
from swarmware.types.rpc import Empty
from swarmware.types.tree import TreeList, TreeListing, TreeSet, TreeSetDone, TypeRequest
from swarmware.types.typed_value import value_of

NEEDED_ARMED: Final = frozenset(
    {"control", "hal", "lidar", "mission", "navigator", "sim", "timesync", "tree"}
)
"""Services without which an armed vehicle does not move safely, beside guard and broker."""
PERIOD_S: Final = 0.2
"""Period of the question whether a service has started or ended."""


class CommandTypes(NamedTuple):
    """The types of a command."""

    request: str
    reply: str


class RequestBlock:
    """Sends a request to a command of this or another platform."""

    spec = spec("Request")

    async def run(self, context: Context) -> None:
        """Ends with the answer; with an error if the answer does not meet its condition."""
        params: resource_params.Request = context.params
        context.report(0.0, f"asks {params.path}")
        async with errors_of_block():
            answer = await ask(context.module, params)
        if params.expect and (
            answer is None or parse_condition(params.expect, VALUE).holds(SingleValue(answer)) is not True
        ):
            raise BlockError("unexpected", f"{params.path}: {answer}; expected {params.expect}")
        context.report(1.0, f"{params.path} has answered")


class SetResourceBlock:
    """Sets a resource by the tree of this platform."""

    spec = spec("SetResource")

    async def run(self, context: Context) -> None:
        """Ends when the owner of the resource has the value."""
        params: resource_params.SetResource = context.params
        order = TreeSet(params.path, msgspec.msgpack.encode(params.value))
        async with errors_of_block():
            await context.module.request("sys/tree/set", order, TreeSetDone)
        context.report(1.0, f"{params.path} is set")


class StartModuleBlock:
    """Starts a service by the guard of this platform."""

    spec = spec("StartModule")

    async def run(self, context: Context) -> None:
        """Ends when the service runs."""
        params: resource_params.ModuleService = context.params
        context.report(0.0, f"starts {params.service}")
        async with errors_of_block():
            await until_state(context.module, StartOrder(params.service), ServiceState.RUNNING)


class StopModuleBlock:
    """Stops a service by the guard of this platform."""

    spec = spec("StopModule")

    async def run(self, context: Context) -> None:
        """Ends when the service has ended."""
        params: resource_params.ModuleService = context.params
        if params.service in NEEDED_ARMED and context.is_armed:
            raise BlockError(
                "refused", f"the armed vehicle flies with {params.service}; expected it disarmed"
            )
        context.report(0.0, f"stops {params.service}")
        async with errors_of_block():
            await until_state(context.module, StopOrder(params.service), ServiceState.STOPPED)


class UserBreakpointBlock:
    """Asks the operator, and waits for the answer."""

    spec = spec("UserBreakpoint")

    async def run(self, context: Context) -> None:
        """Ends when the operator lets the mission continue, or after the time as the mission says."""
        params: resource_params.UserBreakpoint = context.params
        context.report(0.0, f"{ASKS}{params.question} (mission answer {context.module.platform})")
        try:
            async with asyncio.timeout(params.wait_s):
                proceeds, text = await context.questions.ask(context.block_id), "the operator has answered"
        except TimeoutError:
            proceeds, text = params.unanswered == "continue", f"no answer within {params.wait_s:g} s"
        if not proceeds:
            raise BlockError("stopped", f"{params.question} {text}")
        context.report(1.0, text)


async def until_state(module: Module, order: StartOrder | StopOrder, state: ServiceState) -> None:
    """Gives the guard an order, and waits until the service has the state.

    Raises: NotFound, Denied, NoAnswer of the guard, BlockError refused when the service was given up.
    """
    path = "sys/guard/start" if isinstance(order, StartOrder) else "sys/guard/stop"
    status = await module.request(path, order, GuardStatus)
    async for _ in module.every(PERIOD_S):
        found = next((one for one in status.services if one.name == order.service), None)
        if found is None:
            raise NotFound(f"service {order.service!r}: the guard does not have it")
        if found.state == state:
            return
        if found.state == ServiceState.FAILED:
            raise BlockError("refused", f"service {order.service!r}: {found.reason or 'it was given up'}")
        status = await module.request("sys/guard/status", Empty(), GuardStatus)


async def ask(module: Module, params: resource_params.Request) -> msgspec.Struct | None:
    """The answer to a request, or None from a command without an answer, which gets a message.

    Raises: NotFound, TypeMismatch, NoAnswer, the error of the command.
    """
    command = await command_at(module, params.path)
    cls = await class_named(module, params.path, command.request)
    request = value_of(cls, list(params.args) if isinstance(params.args, tuple) else params.args, params.path)
    if command.reply:
        reply = await class_named(module, params.path, command.reply)
        return await module.request(params.path, request, reply, timeout_s=params.answer_s)
    if not (outcome := await module.send(params.path, request, timeout_s=params.answer_s)):
        raise NoAnswer(f"{params.path}: {outcome}")
    return None


async def command_at(module: Module, path: str) -> CommandTypes:
    """Types of the command at a path.

    Raises: NotFound, InvalidInput when another kind of resource is there.
    """
    platform, local = split(path)
    found: tuple[Kind, str, str] | None = None
    if platform in {None, module.platform}:
        provided = (resource for entry in module.node.table for resource in entry.provides)
        found = next(((one.kind, one.type, one.reply) for one in provided if one.path == local), None)
    else:
        listing = await module.request("sys/tree/list", TreeList(path, 1), TreeListing)
        found = next(((one.kind, one.type, one.reply) for one in listing.entries), None)
    if found is None:
        raise NotFound(f"{path}: no such command is known here")
    if found[0] is not Kind.COMMAND:
        raise InvalidInput(f"{path}: a {found[0]}; expected a command")
    return CommandTypes(*found[1:])


async def class_named(module: Module, path: str, name: str) -> type[msgspec.Struct]:
    """Class of a type that is installed here, or that the platform of the path describes.

    Raises: NotFound, NoAnswer, WireError.
    """
    if registry.installed(name):
        return registry.find(name)
    from swarmware.types.described import class_of  # it imports the parser of Python

    question = TypeRequest(name, split(path)[0] or "")
    return class_of(await module.request(join(module.platform, "sys/tree/type"), question, TypeDescription))


@asynccontextmanager
async def errors_of_block() -> AsyncIterator[None]:
    """Converts errors of a request into errors of a block.

    Raises: BlockError not_found, no_answer or refused.
    """
    try:
        yield
    except BlockError:
        raise
    except NotFound as error:
        raise BlockError("not_found", str(error)) from error
    except NoAnswer as error:
        raise BlockError("no_answer", str(error)) from error
    except SwarmError as error:
        raise BlockError("refused", str(error)) from error
