"""Boards that the navigator, the estimator and the guidance read."""

from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import msgspec

from swarmd.navigator.config import Config
from swarmware.geometry.geodesy import Origin
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.module.module import Module
from swarmware.types.control import ControlState
from swarmware.types.navigation import Goal
from swarmware.types.scalar import Float
from swarmware.types.vehicle import GnssFix, Imu, Pose, Range, VehicleState

if TYPE_CHECKING:
    from swarmware.model.airframe import Airframe

T = TypeVar("T", bound=msgspec.Struct)

NEW_PLATFORMS_EVERY = 20
"""Number of calls of `feed` between two checks for new platforms."""


class Fresh(Generic[T]):
    """A board reader that returns each value once."""

    __slots__ = ("_last", "reader")

    def __init__(self, reader: BoardReader[T]) -> None:
        self.reader = reader
        self._last: T | None = None

    def take(self) -> T | None:
        """The newest value, or None if it was returned before."""
        value = self.reader.value
        # by identity, since the reader decodes each value once
        if value is None or value is self._last:
            return None
        self._last = value
        return value

    def stamp_ns(self, now_ns: int) -> int:
        """Stamp of the newest value in the own clock, or now while the clock of its computer is unknown."""
        stamp_ns = self.reader.local_stamp_ns
        return now_ns if stamp_ns is None else stamp_ns


class TakesState(Protocol):
    """A core that takes the state and the driver of the vehicle."""

    def on_vehicle(self, state: VehicleState) -> None: ...
    def on_control(self, control: ControlState) -> None: ...


class TakesSensors(Protocol):
    """A core that estimates the pose from sensors."""

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None: ...
    def on_imu(self, imu: Imu, stamp_ns: int) -> None: ...
    def on_height(self, height_m: float) -> None: ...


class TakesSurroundings(Protocol):
    """A core that steers to a goal between obstacles and other platforms."""

    @property
    def resting(self) -> bool: ...
    def on_scan(self, scan: Range, stamp_ns: int) -> None: ...
    def on_goal(self, goal: Goal, now_ns: int) -> None: ...
    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None: ...


class StateInputs:
    """Inputs of estimation and guidance: the state of the vehicle, and its driver."""

    def __init__(self, m: Module) -> None:
        self._vehicle = Fresh(m.reader("vehicle/state", VehicleState))
        self._control = Fresh(m.reader("control/state", ControlState))

    def feed(self, core: TakesState) -> None:
        """Passes new values on to the core."""
        if (vehicle := self._vehicle.take()) is not None:
            core.on_vehicle(vehicle)
        if (control := self._control.take()) is not None:
            core.on_control(control)


class SensorInputs:
    """Inputs of the estimation: position fixes, inertial samples and height."""

    def __init__(self, m: Module, within_s: float | None = None) -> None:
        """`within_s`: delay of a measurement of the inertial unit that the estimation needs."""
        self._gnss = Fresh(m.reader("sensor/gnss", GnssFix))
        self._imu = Fresh(m.reader("sensor/imu", Imu, within_s=within_s))
        self._height = Fresh(m.reader("sensor/height", Float))

    @property
    def imu(self) -> BoardReader[Imu]:
        """The board of inertial samples, which has the highest rate."""
        return self._imu.reader

    def feed(self, core: TakesSensors, now_ns: int) -> None:
        """Passes new values on to the core."""
        if (fix := self._gnss.take()) is not None:
            core.on_gnss(fix, self._gnss.stamp_ns(now_ns))
        if (imu := self._imu.take()) is not None:
            core.on_imu(imu, self._imu.stamp_ns(now_ns))
        if (height := self._height.take()) is not None:
            core.on_height(height.value)


class GuidanceInputs:
    """Inputs of the guidance: scans of obstacles, the goal, and the poses of other platforms."""

    def __init__(self, m: Module) -> None:
        self._others: dict[str, Fresh[Pose]] = {}
        self._calls = 0
        self._scan = Fresh(m.reader("sensor/range", Range))
        self._goal = Fresh(m.reader("nav/goal", Goal))
        self._poses: BoardSet[Pose] = m.readers("/*/nav/pose", Pose)

    def feed(self, core: TakesSurroundings, now_ns: int) -> None:
        """Passes new values on; the poses of other platforms only while the vehicle is not at rest."""
        if (scan := self._scan.take()) is not None:
            core.on_scan(scan, self._scan.stamp_ns(now_ns))
        if (goal := self._goal.take()) is not None:
            core.on_goal(goal, now_ns)
        if core.resting:
            self._calls = 0  # nothing is avoided at rest, and the first step after it reads all platforms
            return
        # the search costs more than the reads of known boards
        if self._calls % NEW_PLATFORMS_EVERY == 0:
            self._add_platforms()
        self._calls += 1
        for platform, board in self._others.items():
            if (pose := board.take()) is not None:
                # never in the future: an error of the clock conversion would give a negative age
                core.on_neighbour(platform, pose, min(board.stamp_ns(now_ns), now_ns))

    def _add_platforms(self) -> None:
        for platform, reader in self._poses.items():
            if platform not in self._others:
                self._others[platform] = Fresh(reader)


def map_origin(m: Module, config: Config) -> Origin:
    """Origin of the map, which the configured world defines."""
    return load(paths.world(m.node.config.share_path, config.world), World).origin


def vehicle_airframe(m: Module) -> "Airframe | None":
    """Airframe that node.toml names, or None for a chassis with its own attitude control.

    Raises: ConfigError with file, key and the expected value.
    """
    config = m.node.config
    if not config.airframe:
        return None
    from swarmware.model.airframe_file import load_airframe  # not loaded by most vehicles

    return load_airframe(config.share_path, config.airframe)


def hovers(m: Module) -> bool:
    """True if the vehicle of this node can stop in the air."""
    airframe = vehicle_airframe(m)
    return m.node.config.kind == PlatformKind.UAV and (airframe is None or airframe.type != "fixed_wing")
