"""The course of a mission: who was in which block, and when the barriers opened. Pure functions."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Final

import msgspec

from swarmlab.measure.clocks import ClockTruth
from swarmware.model.names import natural
from swarmware.types.mission import MissionPhase, MissionProgress, MissionState

Steps = Sequence[tuple[float, MissionProgress]]
"""Steps of one platform's missions with their instants, in order."""
States = Sequence[tuple[float, MissionState]]
"""States that one platform published, with their instants, in order."""

STARTED: Final = "started"
PHASES: Final = {f"state:{phase}": phase for phase in MissionPhase}
"""Events of the mission as a whole, which have no block."""
RECOVERY: Final = "@recovery"
"""Name of the span in which a built-in mission brings the vehicle to safety."""
READY: Final = "@ready"
"""Name of the span between the acceptance of the order and the common start."""
_NAMES: Final = {MissionPhase.READY: READY, MissionPhase.RECOVERING: RECOVERY}
"""Phases that are shown as a span."""


class BlockSpan(msgspec.Struct, frozen=True):
    """A stay in one block."""

    block: str
    type: str
    """Type of the block; empty for the spans of the mission as a whole."""
    start_s: float
    end_s: float
    outcome: str
    """End of the block (ok, timeout, error:…), or "" if it had not ended."""
    text: str = ""
    lane: int = 0
    """0 for the first of the blocks that were active at the same time."""


class MemberTimeline(msgspec.Struct, frozen=True):
    """The course of the mission on one platform."""

    platform: str
    spans: tuple[BlockSpan, ...]
    outcome: MissionPhase | None = None
    """Newest state of the mission, or None without a record."""
    end_s: float | None = None

    @property
    def lanes(self) -> int:
        """Maximum number of blocks that were active at the same time, at least 1."""
        return 1 + max((span.lane for span in self.spans), default=0)


class BarrierPassage(msgspec.Struct, frozen=True):
    """One visit of a barrier by the ensemble."""

    barrier: str
    visit: int
    at_s: float
    """Common instant of release: median over the members."""
    spread_s: float
    """Difference between the first and the last member's instant of release."""
    members: int
    """Number of members that knew the result."""
    broken: bool = False
    """The barrier did not open; `at_s` is when the first member knew it."""


def of_member(platform: str, steps: Steps, end_s: float) -> MemberTimeline:
    """The spans of all blocks; a block that had not ended lasts until `end_s`."""
    open_at: dict[str, tuple[float, MissionProgress]] = {}
    found: list[BlockSpan] = []
    outcome: MissionPhase | None = None
    ended_s: float | None = None
    for t_s, step in steps:
        if not 0 <= t_s <= end_s:
            continue
        key = step.block
        if step.event == STARTED:
            open_at[key] = (t_s, step)
        elif step.event in PHASES:
            # an event of the whole mission ends the span of the phase before it
            _close(found, open_at, "", t_s, "")
            outcome, ended_s = PHASES[step.event], t_s
            if outcome in _NAMES:
                open_at[""] = (t_s, step)
        elif key in open_at:
            _close(found, open_at, key, t_s, step.event, step.text)
    # blocks that never reported their end, such as of a killed node
    for key in list(open_at):
        _close(found, open_at, key, end_s, "")
    # longer spans first, so that enclosing blocks get the upper lanes
    found.sort(key=lambda span: (span.start_s, -span.end_s, span.block))
    return MemberTimeline(platform, _in_lanes(found), outcome, ended_s)


def _close(
    found: list[BlockSpan],
    open_at: dict[str, tuple[float, MissionProgress]],
    key: str,
    end_s: float,
    outcome: str,
    text: str = "",
) -> None:
    began = open_at.pop(key, None)
    if began is None:
        return
    start_s, step = began
    name = key or _NAMES[PHASES[step.event]]
    found.append(BlockSpan(name, step.type if key else "", start_s, end_s, outcome, text))


def _in_lanes(spans: Sequence[BlockSpan]) -> tuple[BlockSpan, ...]:
    free_s: list[float] = []
    """End of the last span of each lane."""
    found = []
    for span in spans:
        lane = next((i for i, until_s in enumerate(free_s) if until_s <= span.start_s), len(free_s))
        free_s[lane : lane + 1] = [span.end_s]
        found.append(msgspec.structs.replace(span, lane=lane))
    return tuple(found)


def passages(
    states: Mapping[str, States], clocks: Mapping[str, ClockTruth], origin_ns: int
) -> tuple[BarrierPassage, ...]:
    """All visits of barriers, from the results that the members published; `origin_ns`: of the command."""
    released: dict[tuple[str, int], dict[str, float]] = {}
    broken: dict[tuple[str, int], dict[str, float]] = {}
    for platform, known in states.items():
        for t_s, state in known:
            for result in state.meetings:
                key = (result.barrier, result.visit)
                if result.leave_ns is None:
                    # the first report counts, since the result is repeated in later states
                    broken.setdefault(key, {}).setdefault(platform, t_s)
                else:
                    released.setdefault(key, {})[platform] = (
                        clocks[platform].clock.to_mono_ns(result.leave_ns) - origin_ns
                    ) / 1e9
    found = []
    for key, instants in released.items():
        ordered = sorted(instants.values())
        found.append(BarrierPassage(*key, median(ordered), ordered[-1] - ordered[0], len(ordered)))
    for key, seen in broken.items():
        # a barrier that opened for one member counts as opened, even if another gave it up
        if key not in released:
            found.append(BarrierPassage(*key, min(seen.values()), 0.0, len(seen), broken=True))
    return tuple(sorted(found, key=lambda passage: (passage.at_s, natural(passage.barrier))))
