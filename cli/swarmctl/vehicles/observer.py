"""Follows the states of vehicles until each has executed its command."""

import asyncio
from collections.abc import Coroutine, Mapping
from typing import Any, Final, Generic, TypeVar

import msgspec

from swarmctl.session.session import Session
from swarmctl.vehicles.snapshot import Done, VehicleSnapshot
from swarmware.errors import NoAnswer, Partial, SwarmError
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.types.mission import INACTIVE, MissionPhase, MissionState
from swarmware.types.navigation import NavStatus
from swarmware.types.vehicle import Pose, VehicleState

T = TypeVar("T", bound=msgspec.Struct)

POLL_S: Final = 0.5
"""Longest time between two evaluations when nothing arrives."""
GRACE_S: Final = 3.0
"""The state of a vehicle may arrive this much later than the end of its mission."""


class VehicleResult(msgspec.Struct, frozen=True):
    """Result of a command at one vehicle."""

    platform: str
    ok: bool
    """The state of the vehicle shows that the command was executed."""
    reached: bool
    """The vehicle received the command."""
    state: str
    """landed 0.0 m disarmed."""
    after_s: float
    mission: str = ""
    """State of the vehicle's mission."""
    armed: bool | None = None
    height_m: float | None = None
    from_home_m: float | None = None
    text: str = ""
    """Reason of a failure, or "" without one."""


class CommandResult(msgspec.Struct, frozen=True):
    """Result of a command at each of its vehicles."""

    command: str
    vehicles: list[VehicleResult]


class EndedResult(VehicleResult, frozen=True):
    """Result of a command that ended without success; any other failure is a missing answer."""


class _Boards(Generic[T]):
    """One board of every platform, including this node."""

    def __init__(self, here: str, own: BoardReader[T], others: BoardSet[T]) -> None:
        self._here = here
        self._own = own
        self._others = others

    def of(self, platform: str) -> BoardReader[T] | None:
        return self._own if platform == self._here else self._others.get(platform)

    def value(self, platform: str) -> T | None:
        reader = self.of(platform)
        return None if reader is None else reader.value

    def sequence(self, platform: str) -> int:
        reader = self.of(platform)
        return 0 if reader is None else reader.sequence

    def stamp_ns(self, platform: str) -> int | None:
        """Stamp on the hardware clock of the platform, or None before the first value."""
        reader = self.of(platform)
        return None if reader is None else reader.stamp_ns

    def changed(self) -> tuple[Coroutine[Any, Any, object], ...]:
        return self._own.changed(), self._others.changed()


class VehicleObserver:
    """The boards with the states of vehicles; what is not mirrored here yet will be."""

    def __init__(self, session: Session, kinds: Mapping[str, PlatformKind]) -> None:
        self._session = session
        self._kinds = kinds
        self._missions = self._board("mission/state", MissionState)
        self._vehicles = self._board("vehicle/state", VehicleState)
        self._navs = self._board("nav/status", NavStatus)
        self._poses = self._board("nav/pose", Pose)
        self._homes = self._board("vehicle/home", Pose)

    def _board(self, path: str, cls: type[T]) -> _Boards[T]:
        module = self._session.module
        return _Boards(self._session.here, module.reader(path, cls), module.readers(f"/*/{path}", cls))

    def snapshot(self, platform: str, vehicle: VehicleState | None = None) -> VehicleSnapshot:
        """Newest states of a vehicle; `vehicle`: newer than its board, from its own answer."""
        mission = self._missions.value(platform)
        stamps = [board.stamp_ns(platform) for board in (self._vehicles, self._navs, self._poses)]
        return VehicleSnapshot(
            self._kinds.get(platform) or (mission.kind if mission else NO_KIND),
            mission,
            vehicle or self._vehicles.value(platform),
            self._navs.value(platform),
            self._poses.value(platform),
            self._homes.value(platform),
            self._missions.stamp_ns(platform) or 0,
            min((stamp_ns for stamp_ns in stamps if stamp_ns is not None), default=0),
        )

    def mission_sequence(self, platform: str) -> int:
        """Sequence of its board `mission/state`."""
        return self._missions.sequence(platform)

    async def changed(self) -> None:
        """Returns when a state changed, or after POLL_S."""
        boards = (self._missions, self._vehicles, self._navs)
        await first_of(*(wait for board in boards for wait in board.changed()), timeout_s=POLL_S)

    def result(
        self,
        platform: str,
        ok: bool,
        reached: bool,
        after_s: float,
        text: str = "",
        vehicle: VehicleState | None = None,
        *,
        ended: bool = False,
    ) -> VehicleResult:
        """The result for one vehicle, with its newest state; `ended`: the command ended without success."""
        snapshot = self.snapshot(platform, vehicle)
        away_m = snapshot.from_home_m
        words = snapshot.words() if snapshot.kind != PlatformKind.GCS else ""
        return (EndedResult if ended else VehicleResult)(
            platform,
            ok,
            reached,
            # a vehicle that was not reached may be in another state by now
            words if reached or not words else f"last state {words}",
            round(after_s, 1),
            snapshot.mission.state if snapshot.mission else "",
            snapshot.vehicle.armed if snapshot.vehicle else None,
            round(snapshot.pose.z_m, 2) if snapshot.pose else None,
            None if away_m is None else round(away_m, 1),
            text,
        )


class ManoeuvreProgress:
    """Follows one vehicle from a command to its mission until it is done or has failed."""

    def __init__(self, sequence: int, done: Done) -> None:
        self._sequence = sequence
        self._done = done
        self._ended_ns: int | None = None
        self._end_stamp_ns = 0

    def verdict(self, snapshot: VehicleSnapshot, sequence: int, now_ns: int) -> bool | None:
        """Whether the command succeeded, or None while it is not decided."""
        mission = snapshot.mission
        # the mission runs, or its state is from before the command: an end seen earlier was another
        # mission's
        if mission is None or sequence == self._sequence or mission.state not in INACTIVE:
            self._ended_ns = None
            return None
        # a station has no vehicle whose state could confirm the end
        if snapshot.kind == PlatformKind.GCS:
            return True
        if mission.state is not MissionPhase.FAILED and self._done(snapshot):
            return True
        if self._ended_ns is None:
            self._ended_ns, self._end_stamp_ns = now_ns, snapshot.mission_ns
        # boards that a rate limit delays still have the states from before the end; after a failure nothing
        # is waited for: a vehicle that was refused its arming does not change its state
        settled = mission.state is MissionPhase.FAILED or snapshot.states_ns >= self._end_stamp_ns
        over = settled and now_ns - self._ended_ns > GRACE_S * 1e9
        # an earlier failed mission is reported until the command was received
        return self._done(snapshot) if over else None


def print_result(session: Session, seen: VehicleResult, *, home: bool = False) -> None:
    """Prints one line for a vehicle; `home`: with its distance from where it was armed."""
    if session.settings.structured:
        return
    words = [
        seen.platform,
        seen.state or f"mission {seen.mission or 'unknown'}",
        f"after {seen.after_s:.1f} s",
    ]
    if home and seen.from_home_m is not None:
        words.insert(2, f"{seen.from_home_m:.1f} m from its start")
    session.out.now(" ".join(words) + (f": {seen.text}" if seen.text else ""))


def raise_failures(what: str, found: list[VehicleResult]) -> None:
    """Check that all vehicles succeeded.

    Raises: Partial when some did not, NoAnswer or SwarmError when none did.
    """
    bad = [seen for seen in found if not seen.ok]
    if not bad:
        return
    text = f"{what}: {', '.join(f'{seen.platform} ({seen.text})' for seen in bad)}"
    if len(bad) < len(found):
        raise Partial(text)
    # each answered, so it is a failure and not a missing answer: the exit codes differ
    if all(isinstance(seen, EndedResult) for seen in bad):
        raise SwarmError(text)
    raise NoAnswer(text)


async def first_of(*waits: Coroutine[Any, Any, object], timeout_s: float) -> None:
    """Returns when the first of them does, or after `timeout_s`; the others are cancelled."""
    tasks = [asyncio.ensure_future(wait) for wait in waits]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED, timeout=timeout_s)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
