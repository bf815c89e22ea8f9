"""Orders built-in missions: sends them to all vehicles, and follows each vehicle until it has finished."""

import asyncio
from collections.abc import Mapping

from swarmctl.session.session import Session
from swarmctl.vehicles.observer import (
    BUILT_IN,
    CommandResult,
    ManoeuvreProgress,
    VehicleObserver,
    VehicleResult,
    print_result,
    raise_failures,
)
from swarmctl.vehicles.selection import choose, mission_states, stations_left
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionAbort

ABORT = "cmd/abort"


async def manoeuvre(
    session: Session, order: MissionAbort, chosen: Mapping[str, PlatformKind], wait_s: float
) -> list[VehicleResult]:
    """Orders a built-in mission at these vehicles; returns the result of each. Ground stations only stop."""
    observer = VehicleObserver(session, chosen)
    progress = {
        name: ManoeuvreProgress(observer.mission_sequence(name), BUILT_IN[order.then]) for name in chosen
    }
    begin_ns = session.module.now_ns()

    def after_s() -> float:
        return (session.module.now_ns() - begin_ns) / 1e9

    found: dict[str, VehicleResult] = {}

    def settle(seen: VehicleResult) -> None:
        found[seen.platform] = seen
        print_result(session, seen, home=order.then == "return")

    async def send(name: str) -> None:
        text = await _send(session, name, order)
        if text:
            settle(observer.result(name, False, False, after_s(), text))

    await asyncio.gather(*(send(name) for name in chosen))
    while len(found) < len(chosen) and after_s() < wait_s:
        for name in [name for name in chosen if name not in found]:
            snapshot = observer.snapshot(name)
            verdict = progress[name].verdict(
                snapshot, observer.mission_sequence(name), session.module.now_ns()
            )
            if verdict is not None:
                why = snapshot.mission.text if snapshot.mission else ""
                text = "" if verdict else f"{order.then} ended, but its state does not confirm it: {why}"
                settle(observer.result(name, verdict, True, after_s(), text, ended=not verdict))
        if len(found) < len(chosen):
            await observer.changed()
    for name in [name for name in chosen if name not in found]:
        settle(
            observer.result(name, False, True, after_s(), f"not confirmed by its state within {wait_s:g} s")
        )
    return [found[name] for name in chosen]


async def _send(session: Session, name: str, order: MissionAbort) -> str:
    """Why the command was not delivered; empty when it was."""
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
