"""Observes a swarm from its ground station: known platforms and progress of the mission, by events."""

import asyncio
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import msgspec

from swarmctl.session.session import Session
from swarmware.errors import NoAnswer
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.types.health import HealthState
from swarmware.types.mission import INACTIVE, NOT_STARTED, MissionPhase, MissionState
from swarmware.types.navigation import NavStatus
from swarmware.types.traffic import Traffic
from swarmware.types.vehicle import BatteryState, Pose, VehicleState

STATE: Final = "mission/state"
GOOD: Final = MissionPhase.DONE
SHOWN: Final[dict[str, type[msgspec.Struct]]] = {
    "nav/pose": Pose,
    "nav/status": NavStatus,
    "power/battery": BatteryState,
    "vehicle/state": VehicleState,
    "health/state": HealthState,
}
"""Boards of each vehicle that an operator's console needs in addition to the mission's board."""
LOST: Final = "lost"
"""State of a member that was restarted and does not know the mission."""
ENDED: Final = INACTIVE | {LOST}
"""States that a mission does not leave."""
UNKNOWN: Final = "unknown"
"""No state of the member's mission was received."""
POLL_S: Final = 1.0
"""Maximum wait, so that deadlines are checked."""


class MissionOutcome(msgspec.Struct, frozen=True):
    """Outcome of a mission."""

    states: dict[str, str]
    """Last state of each member."""
    in_time: bool
    reasons: Mapping[str, str] = {}
    """Text for operators of each member that gave one; a failed block states there what failed."""

    @property
    def completed(self) -> bool:
        """Whether the mission was successful at every member."""
        return self.in_time and bool(self.states) and all(state == GOOD for state in self.states.values())

    def failure(self) -> str:
        """Description of the failure, or "" if completed."""
        if self.completed:
            return ""
        bad = [
            f"{name} {'not started' if state == NOT_STARTED else state}"
            + (f" ({reason})" if (reason := self.reasons.get(name)) else "")
            for name, state in sorted(self.states.items())
            if state != GOOD
        ]
        return ("out of time: " if not self.in_time else "") + (", ".join(bad) or "no platform took part")


class MissionMembers:
    """Members of one mission and their newest states."""

    def __init__(self, names: Collection[str], epoch: int) -> None:
        self._names = tuple(names)
        self._epoch = epoch
        self.states: dict[str, MissionState] = {}
        """Newest states of this mission, of the members from which one was received."""

    def take(self, now: Mapping[str, MissionState]) -> None:
        """Takes the newest state of every platform."""
        for name in self._names:
            state, before = now.get(name), self.states.get(name)
            if state is not None and state.epoch == self._epoch:
                self.states[name] = state
            # another epoch after a running mission: the member was restarted, and has lost it
            elif state is not None and before is not None and before.state not in ENDED:
                self.states[name] = msgspec.structs.replace(before, state=LOST, active=(), text="")

    def outcome(self, *, in_time: bool) -> MissionOutcome:
        """The outcome as far as known."""
        known = {name: self.states[name].state if name in self.states else UNKNOWN for name in self._names}
        reasons = {name: state.text for name, state in self.states.items() if state.text}
        return MissionOutcome(known, in_time, reasons)

    @property
    def ended(self) -> bool:
        """Whether the mission has ended at every member."""
        return self.states.keys() == set(self._names) and all(
            state.state in ENDED for state in self.states.values()
        )


class SwarmWatch:
    """States of all platforms that an operator's console needs (S0.77)."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._station = session.here
        self._own: BoardReader[MissionState]
        self._states: BoardSet[MissionState]
        self._boards: dict[str, BoardSet[Any]] = {}

    @classmethod
    def open(cls, session: Session) -> "SwarmWatch":
        """Subscribes to the boards."""
        watch = cls(session)
        watch._own = session.module.reader(STATE, MissionState)
        watch._states = session.module.readers(f"/*/{STATE}", MissionState)
        for path, kind in SHOWN.items():
            watch._boards[path] = session.module.readers(f"/*/{path}", kind)
        return watch

    def states(self) -> dict[str, MissionState]:
        """Every platform's newest mission state."""
        found = {name: value for name, board in self._states.items() if (value := board.value) is not None}
        if (own := self._own.value) is not None:
            found[self._station] = own
        return found

    def lacking(self, vehicles: Collection[str]) -> dict[str, list[str]]:
        """For each board the vehicles whose value is missing or prevents a mission."""
        found = {STATE: sorted(set(vehicles) - self.states().keys())}
        for path, boards in self._boards.items():
            found[path] = sorted(name for name in vehicles if not _good(boards, name))
        return {path: names for path, names in found.items() if names}

    async def until_known(
        self, vehicles: Collection[str], timeout_s: float, on_change: Callable[[int], None]
    ) -> None:
        """Returns when the ground station has all boards of all these vehicles, and none reports an error.

        Raises: NoAnswer naming what is missing.
        """
        deadline_s = asyncio.get_running_loop().time() + timeout_s
        while lacking := self.lacking(vehicles):
            on_change(len(vehicles) - len({name for names in lacking.values() for name in names}))
            path, names = next(iter(lacking.items()))
            if asyncio.get_running_loop().time() > deadline_s:
                raise NoAnswer(
                    f"{', '.join(names)}: no valid {path} at {self._station}; expected within {timeout_s:g} s"
                )
            # one board after the other: waking at each pose of each vehicle would load a core
            await self._change(self._states if path == STATE else self._boards[path])
        on_change(len(vehicles))

    async def until_quiet(self, timeout_s: float) -> bool:
        """Returns when the initial exchange of trees and subscriptions is complete; False at the time-out.

        Criterion: between two reports the ground station's broker sent fewer messages than it has neighbours.
        """
        reports = self._session.module.reader("net/traffic", Traffic)
        deadline_s = asyncio.get_running_loop().time() + timeout_s
        before = await reports.changed(timeout_s)
        while asyncio.get_running_loop().time() < deadline_s:
            after = await reports.changed(timeout_s)
            seconds = (after.at_ns - before.at_ns) / 1e9
            # requests
            if after.sent_frames - before.sent_frames < len(self._states) * seconds:
                return True
            before = after
        return False

    async def until_ended(
        self,
        members: MissionMembers,
        timeout_s: float,
        on_change: Callable[[Mapping[str, MissionState]], None],
    ) -> bool:
        """Returns when the mission has ended on all members; False at the time-out."""
        deadline_s = asyncio.get_running_loop().time() + timeout_s
        while True:
            members.take(self.states())
            on_change(members.states)
            if members.ended:
                return True
            if asyncio.get_running_loop().time() > deadline_s:
                return False
            await self._change(self._states)

    async def _change(self, boards: BoardSet[Any]) -> None:
        """Waits for a change of these boards, or of the own mission, at most POLL_S."""
        waits: list[asyncio.Task[Any]] = [
            asyncio.create_task(boards.changed(POLL_S), name=boards.pattern),
            asyncio.create_task(self._own.changed(POLL_S), name=STATE),
        ]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in waits:
                task.cancel()
            # a time-out is not an error here: the caller checks the clock
            await asyncio.gather(*waits, return_exceptions=True)


def _good(boards: BoardSet[Any], platform: str) -> bool:
    value = boards[platform].value if platform in boards else None
    # a mission is refused by a vehicle in error, so it counts as missing
    return value is not None and not (isinstance(value, HealthState) and value.level == "error")
