"""The members of a running mission, as they are heard by the node that was joined."""

import asyncio
from collections.abc import Coroutine
from typing import Any, Final

from swarmctl.connect import Link
from swarmware import names
from swarmware.errors import NotFound, Partial, SwarmError
from swarmware.types.mission import MissionState, MissionStatus
from swarmware.types.rpc import Empty

ENDED: Final = frozenset({"done", "failed", "aborted"})
BAD: Final = frozenset({"failed", "aborted"})
SILENT_S: Final = 5.0
"""A member says its state once a second at least; after five of them it is not waited for."""


async def running(link: Link) -> tuple[int, tuple[str, ...]]:
    """The mission of the platform that is asked about: its run, and the members.

    Raises: NotFound when it has none.
    """
    found = await link.ask("sys/mission/status", Empty(), MissionStatus)
    if found.state.state == "idle":
        raise NotFound(f"{found.platform}: no mission; expected one that was started")
    return found.state.epoch, tuple(member.platform for member in found.members) or (found.platform,)


async def follow(link: Link, epoch: int, members: tuple[str, ...]) -> None:
    """A line for each change of a member in this run, until it has ended for all.

    Raises: SwarmError when it ended badly for one, Partial when one fell silent.
    """
    others = await link.module.readers("/*/mission/state", MissionState)
    own = await link.module.reader("mission/state", MissionState)
    shown: dict[str, MissionState] = {}
    heard: dict[str, tuple[int | None, int]] = {}
    silent: set[str] = set()
    while True:
        now_ns = link.module.now_ns()
        for platform in members:
            reader = own if platform == link.here else others.get(platform)
            state = None if reader is None else reader.value
            stamp_ns = None if reader is None else reader.stamp_ns
            if platform not in heard or heard[platform][0] != stamp_ns:
                heard[platform] = (stamp_ns, now_ns)
                silent.discard(platform)
            # a board still shows the run before until its member has taken the order
            if state is None or state.epoch != epoch or state.state == "idle":
                pass
            elif platform not in shown or told(state) != told(shown[platform]):
                shown[platform] = state
                _tell(link, platform, state)
            ended = platform in shown and shown[platform].state in ENDED
            if not ended and now_ns - heard[platform][1] > SILENT_S * 1e9 and platform not in silent:
                silent.add(platform)
                link.out.warn(f"{platform}: not heard for {SILENT_S:g} s")
        ended_by = {platform for platform, state in shown.items() if state.state in ENDED}
        if ended_by | silent >= set(members):
            break
        await _either(own.changed(), others.changed(), timeout_s=1.0)
    bad = sorted((platform for platform in ended_by if shown[platform].state in BAD), key=names.natural)
    if silent:
        raise Partial(f"mission: {', '.join(sorted(silent, key=names.natural))} fell silent before its end")
    if bad:
        name = shown[bad[0]].mission
        raise SwarmError(
            f"mission {name}: ended badly at {', '.join(f'{p} ({shown[p].state})' for p in bad)}"
        )


def told(state: MissionState) -> object:
    """What makes a line of its own."""
    return state.state, state.mission, state.active, state.text


def _tell(link: Link, platform: str, state: MissionState) -> None:
    if link.settings.json:
        link.out.line({"platform": platform, "state": state})
    else:
        blocks = ", ".join(state.active)
        link.out.now(
            f"{platform:<8} {state.mission:<12} {state.state:<10} {blocks:<24} {state.text}".rstrip()
        )


async def _either(*waits: Coroutine[Any, Any, object], timeout_s: float) -> None:
    """Returns when the first of them does, or in time; the others are given up."""
    tasks = [asyncio.ensure_future(wait) for wait in waits]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED, timeout=timeout_s)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
