"""The table of the hosts: reached, version, running, since, configuration, synchronised."""

import asyncio
from collections.abc import Sequence
from typing import Final

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.fleet.plan import HostStatus
from swarmctl.commands.fleet.remote import Remote
from swarmctl.commands.fleet.synchronisation import Synchronisation, synchronisation
from swarmctl.membership.hosts import FleetHost, digest, files
from swarmctl.terminal.node_output import raise_errors
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Detail, rows_of
from swarmware.errors import SwarmError

ANSWER_S: Final = 30.0
"""Maximum wait for another call of `fleet` that acts on the host."""


class ListedHost(msgspec.Struct, frozen=True):
    """One host and its node."""

    host: str
    address: str
    status: HostStatus | None
    """State of the host, or null if it was not reached."""
    config: str
    """State of the pushed files: current, changed, restart (pushed after the start) or none."""
    synchronised: bool | None = None
    """Whether the data are synchronised with the operator's node, or null if not examined."""
    error: str = ""
    exit_code: int = 0


class FleetList(msgspec.Struct, frozen=True):
    """The hosts of a file, and their state."""

    hosts: list[ListedHost]


async def list_hosts(settings: CliSettings, hosts: Sequence[FleetHost]) -> None:
    """Prints the hosts.

    Raises: as `raise_errors`.
    """
    out = Output(settings)
    errors: dict[str, SwarmError] = {}
    async with synchronisation(settings) as sync:

        async def one(host: FleetHost) -> ListedHost:
            try:
                seen = await Remote(host, settings.timeout_s, ANSWER_S).status()
                state = config_state(seen, digest(files(host)))
            except (SwarmError, OSError) as error:
                failure = error if isinstance(error, SwarmError) else SwarmError(str(error))
                errors[host.name] = failure
                return ListedHost(
                    host.name, host.address, None, "none", None, str(failure), failure.exit_code
                )
            # a stopped node has nothing to compare
            synchronised = await _synchronised(sync, host.name) if seen.answers else None
            return ListedHost(host.name, host.address, seen, state, synchronised)

        listed = await asyncio.gather(*(one(host) for host in hosts))
    if settings.structured:
        out.document(FleetList(list(listed)))
    else:
        _print(out, listed)
    raise_errors(len(hosts), errors)


async def _synchronised(sync: Synchronisation | None, platform: str) -> bool | None:
    return None if sync is None else not await sync.missing(platform)


def config_state(seen: HostStatus, wanted: str) -> str:
    """Whether the pushed files equal the operator's files, and whether the node runs with them."""
    if not seen.config:
        return "none"
    if seen.config != wanted:
        return "changed"
    # "" means that `fleet` did not start the node, so nothing is known about its start
    return "restart" if seen.running and seen.started_config not in {"", wanted} else "current"


def _print(out: Output, listed: Sequence[ListedHost]) -> None:
    details: list[Detail[ListedHost]] = [
        Detail("HOST", value=lambda one: one.host),
        Detail("ADDRESS", value=lambda one: one.address, drop=2),
        Detail("STATE", value=lambda one: state_text(one.status)),
        Detail("VERSION", value=lambda one: one.status.version if one.status else None, drop=1),
        Detail("UP", value=lambda one: _up(one.status), right=True),
        Detail("CONFIG", value=lambda one: one.config if one.status else None),
        Detail("ARMED", value=lambda one: one.status.armed if one.status else None),
        Detail("SYNC", value=lambda one: one.synchronised),
    ]
    if any(one.error for one in listed):
        details.append(Detail("ERROR", value=lambda one: one.error))
    out.table(details, rows_of(details, listed))


def _up(seen: HostStatus | None) -> str | None:
    return None if seen is None or seen.uptime_s is None else spoken(seen.uptime_s)


def state_text(seen: HostStatus | None) -> str:
    """failed | not installed | not configured | stopped | being upgraded | silent | running."""
    if seen is None:
        return "failed"
    if seen.running:
        return "running" if seen.answers else "silent"
    if not seen.installed:
        return "not installed"
    if seen.resume:
        return "being upgraded"
    return "stopped" if seen.configured else "not configured"
