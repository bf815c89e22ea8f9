"""State, checks and faults of platforms, from their monitors."""

import msgspec

from swarmctl.commandline.nodes import names_one
from swarmctl.resources.fanout import warn_errors
from swarmctl.resources.platform_health import platform_health
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Cell, Column, Detail, rows_of
from swarmware.errors import NotFound, Partial
from swarmware.types.health import (
    CheckState,
    Fault,
    FaultClear,
    FaultList,
    FaultQuery,
    HealthReport,
    HealthState,
)
from swarmware.types.rpc import Empty


class PlatformHealth(msgspec.Struct, frozen=True):
    """Health of a platform, with None as state if it did not answer."""

    platform: str
    state: HealthState | None


class HealthStates(msgspec.Struct, frozen=True):
    """The health states of platforms."""

    platforms: list[PlatformHealth]
    silent: list[str]
    """Platforms that did not answer."""


async def list_states(session: Session) -> None:
    """Prints the state of the selected platforms, else of all.

    Raises: Partial when a platform did not answer; the error itself when one was named.
    """
    asked = await session.selected()
    states, errors = await platform_health(session, asked)
    if session.platform in errors and names_one(session.settings.node):
        raise errors[session.platform]
    if session.settings.structured:
        rows = [PlatformHealth(platform, states.get(platform)) for platform in asked]
        session.out.document(HealthStates(rows, sorted(errors)))
    else:
        columns = [
            Column("PLATFORM"),
            Column("LEVEL"),
            Column("BATTERY", right=True),
            Column("APPS", right=True, drop=1),
            Column("FAILED", right=True),
            Column("GUARD"),
            Column("CHECKS", right=True, drop=2),
            Column("FAULTS"),
        ]
        session.out.table(columns, [_row(platform, states.get(platform)) for platform in asked])
    warn_errors(session, errors)
    if errors:
        raise Partial(f"health: {len(errors)} of {len(asked)} platforms did not answer")


def _row(platform: str, state: HealthState | None) -> tuple[Cell, ...]:
    if state is None:
        return (platform, "silent", *[None] * 6)
    battery = f"{state.battery_ratio * 100:.0f} % {state.battery}" if state.battery_ratio >= 0 else None
    more = state.fault_count - len(state.faults)
    faults = ", ".join(state.faults) + (f" and {more} more" if more > 0 else "")
    return (
        platform,
        state.level,
        battery,
        state.apps_alive,
        state.apps_failed,
        state.guard,
        state.checks,
        faults or "none",
    )


async def show_checks(session: Session) -> None:
    """Prints each check of a platform and its newest result."""
    report = await session.ask("sys/health/state", Empty(), HealthReport)
    if session.settings.structured:
        session.out.document(report)
        return
    details: list[Detail[CheckState]] = [
        Detail("CHECK", value=lambda check: check.check),
        Detail("BY", value=lambda check: check.app),
        Detail("STATE", value=lambda check: check.state),
        Detail("LEVEL", value=lambda check: check.level),
        Detail("HZ", value=lambda check: f"{check.frequency_hz:g}", right=True),
        # a check that never changed has no instant: the state holds since the monitor started
        Detail(
            "SINCE",
            value=lambda check: (
                spoken((report.stamp_ns - check.since_ns) / 1e9) if check.since_ns else "start"
            ),
            right=True,
        ),
    ]
    title = f"{report.platform}: {report.state.level}"
    session.out.table(details, rows_of(details, report.checks), title, empty=f"{title}, no checks")


async def list_faults(session: Session, cleared: bool) -> None:
    """Prints the faults of a platform; with `cleared` also cleared ones."""
    found = await session.ask("sys/health/faults", FaultQuery(cleared), FaultList)
    if session.settings.structured:
        session.out.document(found)
        return
    details: list[Detail[Fault]] = [
        Detail("CHECK", value=lambda fault: fault.check),
        Detail("STATE", value=lambda fault: fault.state),
        Detail("LEVEL", value=lambda fault: fault.level),
        Detail("PHASE", value=lambda fault: str(fault.phase)),
        Detail("COUNT", value=lambda fault: fault.count, right=True),
        Detail("FIRST AGO", value=lambda fault: spoken((found.stamp_ns - fault.first_ns) / 1e9), right=True),
        Detail("LAST AGO", value=lambda fault: spoken((found.stamp_ns - fault.last_ns) / 1e9), right=True),
        Detail("WHAT", value=lambda fault: fault.what),
    ]
    hint = "" if cleared else "; --cleared shows cleared ones"
    session.out.table(details, rows_of(details, found.faults), empty=f"{found.platform}: no faults{hint}")


async def clear_faults(session: Session, pattern: str, *, yes: bool) -> None:
    """Clears the faults whose check matches; asks before.

    Raises: NotFound when none does; as `Session.confirm`.
    """
    await session.confirm(yes, f"clear the faults that match {pattern}")
    cleared = await session.ask("sys/health/clear", FaultClear(pattern), FaultList)
    # to clear all faults of a node without faults is not an error
    if not cleared.faults and pattern != "**":
        raise NotFound(f"{cleared.platform}: no fault matches {pattern}; `health faults` lists them")
    if session.settings.structured:
        session.out.document(cleared)
    for fault in cleared.faults:
        session.out.say(f"{cleared.platform}: {fault.check}: {fault.state} cleared")
