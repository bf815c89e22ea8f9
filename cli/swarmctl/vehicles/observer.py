"""Follows the states of vehicles until each has executed its command."""

import asyncio
import math
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, Final, Generic, TypeVar

import msgspec

from swarmctl.session.session import Session
from swarmware.errors import NoAnswer, Partial, SwarmError
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.types.mission import INACTIVE, MissionPhase, MissionState
from swarmware.types.vehicle import NavState, NavStatus, Pose, VehicleState

T = TypeVar("T", bound=msgspec.Struct)

STANDING: Final = frozenset({NavState.HOLDING, NavState.ARRIVED, NavState.IDLE})
"""States of a navigator that holds its position."""
STILL_M_S: Final = 0.5
"""Speed below which a vehicle counts as holding: wind and noise cause small motions."""
NEAR_M: Final = 1.0
"""Distance from a commanded place within which a vehicle has arrived."""
CIRCLE_RATIO: Final = 0.1
"""Distance from its circle over the radius within which a vehicle that cannot stop is on it; the navigator's
own is 0.06."""
CIRCLING_HEIGHT_M: Final = 3.0
"""Error of the height within which such a vehicle has climbed to its altitude; the navigator's own is 2 m."""
APPROACH_RATIO: Final = 4.0
"""Distance over the same radius within which such a vehicle has returned: it lands beside its circle."""
HOME_M: Final = 3.0
"""Distance from the place of arming within which a vehicle has returned: the drift of GNSS."""
POLL_S: Final = 0.5
"""Longest time between two evaluations when nothing arrives."""
GRACE_S: Final = 3.0
"""The state of a vehicle may arrive this much later than the end of its mission."""


class VehicleSnapshot(msgspec.Struct, frozen=True):
    """Newest states of one vehicle."""

    kind: PlatformKind
    mission: MissionState | None
    vehicle: VehicleState | None
    nav: NavStatus | None
    pose: Pose | None
    home: Pose | None
    mission_ns: int = 0
    """Stamp of the state of its mission, on its hardware clock."""
    states_ns: int = 0
    """Oldest stamp among its state, its navigator's and its pose, on the same clock."""

    @property
    def speed_m_s(self) -> float:
        """Speed over the ground and vertically; infinite without a pose."""
        pose = self.pose
        return math.inf if pose is None else math.hypot(pose.vx_m_s, pose.vy_m_s, pose.vz_m_s)

    @property
    def held_by(self) -> str:
        """Operator or pilot that drives it by hand; empty: none."""
        return self.mission.held_by if self.mission else ""

    @property
    def from_home_m(self) -> float | None:
        """Horizontal distance from the place where it was armed; None: unknown."""
        if self.pose is None or self.home is None:
            return None
        return math.hypot(self.pose.x_m - self.home.x_m, self.pose.y_m - self.home.y_m)

    @property
    def circle_m(self) -> float:
        """Radius of the circle by which it keeps a place; 0: it stops there."""
        return self.nav.circle_m if self.nav is not None else 0.0

    @property
    def near_m(self) -> float:
        """Distance from a place, or from the circle around it, within which it has arrived."""
        return NEAR_M + CIRCLE_RATIO * self.circle_m

    @property
    def settled(self) -> bool:
        """Whether it has stopped, or circles and cannot do more."""
        if self.circle_m > 0.0:
            return self.nav is not None and self.nav.state in STANDING
        return self.speed_m_s < STILL_M_S

    @property
    def standing(self) -> bool:
        """Whether it keeps its position, on the ground or in the air."""
        if self.vehicle is None:
            return False
        if self.kind == PlatformKind.UAV and self.vehicle.landed:
            return True
        return self.nav is not None and self.nav.state in STANDING and self.settled

    def away_m(self, x_m: float, y_m: float, z_m: float | None) -> float:
        """Distance from a place, or from the circle around it; without a height only the horizontal one."""
        if self.pose is None:
            return math.inf
        flat_m = abs(math.hypot(self.pose.x_m - x_m, self.pose.y_m - y_m) - self.circle_m)
        return math.hypot(flat_m, 0.0 if z_m is None else self.pose.z_m - z_m)

    @property
    def grounded(self) -> bool:
        """Whether it is on the ground, stopped and disarmed."""
        vehicle = self.vehicle
        if vehicle is None or vehicle.armed or not vehicle.landed:
            return False
        return self.kind == PlatformKind.UAV or self.speed_m_s < STILL_M_S

    def words(self) -> str:
        """Short description: `landed 0.0 m disarmed`."""
        if self.vehicle is None:
            return "unknown"
        if self.kind == PlatformKind.UAV:
            holding = "circling" if self.circle_m > 0.0 else "holding"
            doing = "landed" if self.vehicle.landed else holding if self.standing else "flying"
            if not self.vehicle.armed and not self.vehicle.landed:
                doing = "falling"
        elif self.pose is None:
            doing = "somewhere"
        else:
            doing = "stopped" if self.speed_m_s < STILL_M_S else "moving"
        height = "" if self.pose is None else f" {max(self.pose.z_m, 0.0):.1f} m"
        return f"{doing}{height} {'armed' if self.vehicle.armed else 'disarmed'}"


class VehicleResult(msgspec.Struct, frozen=True):
    """Result of a command at one vehicle."""

    platform: str
    ok: bool
    """Its state shows that the command was executed."""
    reached: bool
    """It received the command."""
    state: str
    """landed 0.0 m disarmed."""
    after_s: float
    mission: str = ""
    """State of the vehicle's mission."""
    armed: bool | None = None
    height_m: float | None = None
    from_home_m: float | None = None
    text: str = ""
    """Reason of a failure; empty: none."""


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
        """On the hardware clock of the platform; None: no value yet."""
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
            words if reached or not words else f"last state {words}",
            round(after_s, 1),
            snapshot.mission.state if snapshot.mission else "",
            snapshot.vehicle.armed if snapshot.vehicle else None,
            round(snapshot.pose.z_m, 2) if snapshot.pose else None,
            None if away_m is None else round(away_m, 1),
            text,
        )


Done = Callable[[VehicleSnapshot], bool]
"""Whether the state of a vehicle shows that the command was executed."""


def returned(snapshot: VehicleSnapshot) -> bool:
    """Whether the vehicle has landed where it was armed."""
    away_m = snapshot.from_home_m
    return snapshot.grounded and (away_m is None or away_m <= max(HOME_M, APPROACH_RATIO * snapshot.circle_m))


def risen_to(altitude_m: float) -> Done:
    """Whether the vehicle holds at this altitude, or above it."""

    def done(snapshot: VehicleSnapshot) -> bool:
        vehicle, pose = snapshot.vehicle, snapshot.pose
        if vehicle is None or pose is None or vehicle.landed or not vehicle.armed:
            return False
        near_m = NEAR_M if snapshot.circle_m == 0.0 else CIRCLING_HEIGHT_M
        return pose.z_m >= altitude_m - near_m and snapshot.settled

    return done


def arrived_at(x_m: float, y_m: float, z_m: float | None) -> Done:
    """Whether the vehicle stands at this place, or circles around it; without a height at any."""
    return lambda snapshot: snapshot.settled and snapshot.away_m(x_m, y_m, z_m) < snapshot.near_m


BUILT_IN: Final[dict[str, Done]] = {
    "land": lambda snapshot: snapshot.grounded,
    "hold": lambda snapshot: snapshot.standing,
    "return": returned,
}
"""Condition that holds after each built-in mission."""


class ManoeuvreProgress:
    """Follows one vehicle from a command to its mission until it is done or has failed."""

    def __init__(self, sequence: int, done: Done) -> None:
        self._sequence = sequence
        self._done = done
        self._ended_ns: int | None = None
        self._end_stamp_ns = 0

    def verdict(self, snapshot: VehicleSnapshot, sequence: int, now_ns: int) -> bool | None:
        """Whether the command succeeded; None while it is not decided."""
        mission = snapshot.mission
        if mission is None or sequence == self._sequence or mission.state not in INACTIVE:
            self._ended_ns = None
            return None
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
