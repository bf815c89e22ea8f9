"""Orders manoeuvres: sends them to all vehicles, and follows each vehicle until it has finished."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping

from swarmctl.session.session import Session
from swarmctl.vehicles.observer import (
    CommandResult,
    ManoeuvreProgress,
    VehicleObserver,
    VehicleResult,
    print_result,
    raise_failures,
)
from swarmctl.vehicles.selection import choose, mission_states, stations_left
from swarmctl.vehicles.snapshot import BUILT_IN, Done
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import ManoeuvreRequest, MissionAbort, MissionStatus

ABORT = "cmd/abort"
MANOEUVRE = "sys/mission/manoeuvre"


async def manoeuvre(
    session: Session, order: MissionAbort, chosen: Mapping[str, PlatformKind], wait_s: float
) -> list[VehicleResult]:
    """Orders a built-in mission at these vehicles; returns the result of each. Ground stations only stop."""

    async def send(name: str) -> str:
        return await _send(session, name, order)

    done = dict.fromkeys(chosen, BUILT_IN[order.then])
    return await follow(session, order.then, chosen, done, send, wait_s)


async def follow(
    session: Session,
    what: str,
    chosen: Mapping[str, PlatformKind],
    done: Mapping[str, Done],
    send: Callable[[str], Awaitable[str]],
    wait_s: float,
) -> list[VehicleResult]:
    """Sends a command to all vehicles, and follows each until its state shows that it is done.

    `send`: sends it to one; its result is the reason of a refusal, or empty.
    """
    observer = VehicleObserver(session, chosen)
    # the sequences from before the order: only a newer state of the mission can be its effect
    progress = {name: ManoeuvreProgress(observer.mission_sequence(name), done[name]) for name in chosen}
    begin_ns = session.module.now_ns()

    def after_s() -> float:
        return (session.module.now_ns() - begin_ns) / 1e9

    found: dict[str, VehicleResult] = {}

    def settle(seen: VehicleResult) -> None:
        found[seen.platform] = seen
        print_result(session, seen, home=what == "return")

    async def begin(name: str) -> None:
        text = await send(name)
        if text:
            settle(observer.result(name, False, False, after_s(), text))

    await asyncio.gather(*(begin(name) for name in chosen))
    while len(found) < len(chosen) and after_s() < wait_s:
        for name in [name for name in chosen if name not in found]:
            snapshot = observer.snapshot(name)
            verdict = progress[name].verdict(
                snapshot, observer.mission_sequence(name), session.module.now_ns()
            )
            if verdict is not None:
                why = snapshot.mission.text if snapshot.mission else ""
                text = "" if verdict else f"{what} ended, but its state does not confirm it: {why}"
                settle(observer.result(name, verdict, True, after_s(), text, ended=not verdict))
        if len(found) < len(chosen):
            await observer.changed()
    for name in [name for name in chosen if name not in found]:
        held_by = observer.snapshot(name).held_by
        text = f"not confirmed by its state within {wait_s:g} s"
        text += f"; driven by {held_by}" if held_by else ""
        settle(observer.result(name, False, True, after_s(), text))
    return [found[name] for name in chosen]


async def _send(session: Session, name: str, order: MissionAbort) -> str:
    """Why the command was not delivered, or "" if it was."""
    try:
        await session.reach(name)
    except SwarmError as error:
        return str(error)
    wait_s = session.settings.timeout_s
    outcome = await session.module.send(names.join(name, ABORT), order, timeout_s=wait_s, urgent=True)
    return "" if outcome.delivered else f"no answer: {outcome}"


async def command(session: Session, then: str, wanted: tuple[str, ...], wait_s: float, reason: str) -> None:
    """`swarmctl hold|land|return` from the names to the result.

    Raises: as `choose` and `judge`.
    """
    chosen = await choose(session, wanted)
    states = mission_states(session)
    stations = stations_left(states, {name: state.kind for name, state in states.items()}, chosen)
    # a station first: the states of the vehicles must not reach it before the order does
    found = await manoeuvre(session, MissionAbort(reason, then), {**stations, **chosen}, wait_s)
    if session.settings.structured:
        session.out.document(CommandResult(then, found))
    raise_failures(then, found)


async def request(
    session: Session,
    requests: Mapping[str, ManoeuvreRequest],
    chosen: Mapping[str, PlatformKind],
    done: Mapping[str, Done],
    wait_s: float,
) -> None:
    """Requests a manoeuvre with parameters of each vehicle, and prints the observations.

    Raises: the refusal, of a single vehicle; as `raise_failures`.
    """
    what = next(iter(requests.values())).name

    async def send(name: str) -> str:
        try:
            await session.reach(name)
            await session.module.request(
                names.join(name, MANOEUVRE),
                requests[name],
                MissionStatus,
                timeout_s=session.settings.timeout_s,
                urgent=True,
            )
        except SwarmError as error:
            if len(requests) == 1:
                raise
            return str(error)
        return ""

    found = await follow(session, what, chosen, done, send, wait_s)
    if session.settings.structured:
        session.out.document(CommandResult(what, found))
    raise_failures(what, found)
