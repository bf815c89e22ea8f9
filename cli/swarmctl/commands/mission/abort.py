"""Aborts a running mission at all its members, or at some."""

import msgspec

from swarmctl.commandline.nodes import EVERY, names_one
from swarmctl.commands.mission.members import find_active
from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.vehicles.manoeuvre import manoeuvre
from swarmctl.vehicles.observer import VehicleResult, raise_failures
from swarmctl.vehicles.selection import choose, is_station
from swarmware.errors import NotFound
from swarmware.types.mission import MissionAbort


class MissionAborted(msgspec.Struct, frozen=True):
    """Result of an abort at each member."""

    reached: list[str]
    """Members that received the order."""
    silent: list[str]
    vehicles: list[VehicleResult]


async def abort(
    session: Session, platforms: tuple[str, ...], reason: str, then: str, wait_s: float, *, yes: bool
) -> None:
    """Makes the members land, hold or return (`then`) and follows them until they have; asks before.

    Raises: NotFound when no mission runs; as `choose` and `raise_failures`.
    """
    node = session.settings.node
    some = node not in {"", EVERY} and not (names_one(node) and await is_station(session, node))
    # a ground station named by -n is only the way to the swarm: then all members are meant
    if platforms or some:
        chosen = await choose(session, platforms)
        what = f"abort the mission at {', '.join(chosen)} only, then {then}; where others wait for it"
        confirm(yes, f"{what} their barriers break")
    else:
        found = await find_active(session)
        if not found.plays:
            raise NotFound(
                f"no mission runs at {', '.join(found.members)}; expected one"
                " (`swarmctl land --all` lands all vehicles)"
            )
        chosen = {name: found.kinds[name] for name in found.members}
        confirm(yes, f"abort {found.mission} at {', '.join(chosen)}, then {then}")
    seen = await manoeuvre(session, MissionAbort(reason, then), chosen, wait_s)
    if session.settings.structured:
        reached = [one.platform for one in seen if one.reached]
        silent = [one.platform for one in seen if not one.reached]
        session.out.document(MissionAborted(reached, silent, seen))
    raise_failures("abort", seen)
