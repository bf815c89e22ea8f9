"""Limits of the rates of a broker's channels, set by an operator."""

from swarmctl.resources.limits import MISSION_STATE
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.model import names
from swarmware.model.names import Pattern
from swarmware.types.net import ChannelLimits, SetChannel, Traffic
from swarmware.types.rpc import Empty


def effect(local: str, max_hz: float | None, duration_s: float) -> str:
    """What a limit does to the swarm that an operator must confirm; empty: no confirmation."""
    end = f"for {duration_s:g} s" if duration_s else "without an end"
    if max_hz == 0.0:
        return f"boards that match {local} are not sent {end}"
    if max_hz is not None and Pattern(local).matches(MISSION_STATE):
        return f"{MISSION_STATE} is sent at {max_hz:g} Hz at most {end}: barriers of a mission wait for it"
    return ""


async def set_limit(
    session: Session, local: str, max_hz: float | None, duration_s: float, *, yes: bool
) -> None:
    """Limits matching boards and prints all limits; `max_hz` None: no limit, `duration_s` 0: no end.

    Raises: as `confirm` and `Session.ask`.
    """
    request = SetChannel(Pattern(local).text, max_hz, duration_s)
    target = session.platform
    await session.reach(target)
    await session.confirm(yes, effect(local, max_hz, duration_s))
    limits = await session.ask(names.join(target, "sys/broker/set_channel"), request, ChannelLimits)
    for path in limits.unlimited:
        session.out.warn(f"/{target}/{path}: not limited, because each of its items is delivered")
    traffic = await session.ask(names.join(target, "sys/broker/traffic"), Empty(), Traffic)
    if not any(Pattern(local).matches(one.channel) for one in traffic.channels):
        session.out.warn(f"{target} has not sent a board that matches {local} yet; the limit is in force")
    if session.settings.structured:
        session.out.document(limits)
        return
    rows = [(one.pattern, one.max_hz, one.remaining_s) for one in limits.limits]
    columns = [Column("PATTERN"), Column("MAX HZ", right=True), Column("LEFT s", right=True)]
    session.out.table(columns, rows, empty=f"{target}: no channel is limited")
