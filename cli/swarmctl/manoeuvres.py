"""Built-in missions on command: sent to each vehicle at once, and followed until each was seen to be done."""

import asyncio
from collections.abc import Mapping

from swarmctl.connect import Link
from swarmctl.observing import BUILT_IN, Course, Observer, Seen, judge, tell
from swarmctl.vehicles import choose
from swarmware import names
from swarmware.errors import SwarmError
from swarmware.types.mission import MissionAbort

ABORT = "cmd/abort"


async def manoeuvre(link: Link, order: MissionAbort, chosen: Mapping[str, str], wait_s: float) -> list[Seen]:
    """Has these vehicles play a built-in mission; what was seen of each. Ground stations only stop."""
    observer = Observer(link, chosen)
    await observer.open()
    courses = {name: Course(observer.told(name), BUILT_IN[order.then]) for name in chosen}
    begin_ns = link.module.now_ns()

    def after_s() -> float:
        return (link.module.now_ns() - begin_ns) / 1e9

    found: dict[str, Seen] = {}

    def settle(seen: Seen) -> None:
        found[seen.platform] = seen
        tell(link, seen, home=order.then == "return")

    async def send(name: str) -> None:
        text = await _sent(link, name, order)
        if text:
            settle(observer.seen(name, False, False, after_s(), text))

    await asyncio.gather(*(send(name) for name in chosen))
    while len(found) < len(chosen) and after_s() < wait_s:
        for name in [name for name in chosen if name not in found]:
            sight = observer.sight(name)
            verdict = courses[name].verdict(sight, observer.told(name), link.module.now_ns())
            if verdict is not None:
                why = sight.mission.text if sight.mission else ""
                text = "" if verdict else f"{order.then} ended: {why}"
                settle(observer.seen(name, verdict, True, after_s(), text))
        if len(found) < len(chosen):
            await observer.changed()
    for name in [name for name in chosen if name not in found]:
        settle(observer.seen(name, False, True, after_s(), f"not seen to be done within {wait_s:g} s"))
    return [found[name] for name in chosen]


async def _sent(link: Link, name: str, order: MissionAbort) -> str:
    """Why the command did not arrive; empty when it did."""
    try:
        await link.reach(name)
    except SwarmError as error:
        return str(error)
    wait_s = link.settings.timeout_s
    outcome = await link.module.send(names.join(name, ABORT), order, timeout_s=wait_s, urgent=True)
    return "" if outcome.delivered else f"no answer: {outcome}"


async def command(
    link: Link, then: str, wanted: tuple[str, ...], wait_s: float, reason: str, *, everything: bool
) -> None:
    """`swarmctl hold|land|return` from the names to the result.

    Raises: as `choose` and `judge`.
    """
    chosen = await choose(link, wanted, everything=everything)
    found = await manoeuvre(link, MissionAbort(reason, then), chosen, wait_s)
    if link.settings.json:
        link.out.document({"command": then, "vehicles": found})
    judge(then, found)
