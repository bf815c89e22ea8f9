"""Runs one command on all hosts and prints its output, each line with the host."""

import asyncio
import sys
from collections.abc import Sequence

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.fleet import ssh
from swarmctl.membership.hosts import FleetHost
from swarmctl.terminal.node_output import raise_errors
from swarmctl.terminal.output import Output
from swarmware.errors import SwarmError
from swarmware.model.visible import visible


class FleetOutput(msgspec.Struct, frozen=True):
    """A line that a command printed on a host, or its end."""

    host: str
    stream: str
    """stdout, stderr; `exit` at the end."""
    line: str = ""
    exit_code: int | None = None
    """Exit code of the command, or null while it runs or if the host was not reached."""
    error: str = ""


async def execute(
    settings: CliSettings, hosts: Sequence[FleetHost], words: Sequence[str], parallel: int
) -> None:
    """Runs a command on all hosts.

    Raises: Partial when it failed on some, SwarmError of one kind when on all.
    """
    out = Output(settings)
    errors: dict[str, SwarmError] = {}
    slots = asyncio.Semaphore(parallel)
    streams = {"stdout": sys.stdout, "stderr": sys.stderr}

    async def one(host: FleetHost) -> None:
        async with slots:
            try:
                code = await ssh.follow(
                    host,
                    words,
                    settings.timeout_s,
                    lambda stream, line: show(FleetOutput(host.name, stream, line)),
                )
            except SwarmError as error:
                errors[host.name] = error
                show(FleetOutput(host.name, "exit", error=str(error)))
                return
        if code:
            errors[host.name] = SwarmError(f"exit code {code}")
        show(FleetOutput(host.name, "exit", exit_code=code))

    def show(item: FleetOutput) -> None:
        if settings.structured:
            out.line(item)
        elif item.stream != "exit":
            print(visible(f"{item.host}: {item.line}"), file=streams[item.stream], flush=True)
        elif item.error or item.exit_code:
            out.warn(f"{item.host}: {item.error or f'exit code {item.exit_code}'}")

    async with asyncio.TaskGroup() as group:
        for host in hosts:
            group.create_task(one(host), name=host.name)
    raise_errors(len(hosts), errors)
