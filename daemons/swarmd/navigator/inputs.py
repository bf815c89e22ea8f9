"""The boards that the navigator reads, and their new values."""

from typing import Generic, TypeVar

import msgspec

from swarmd.navigator.core.navigator import NavigatorCore
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.module.module import Module
from swarmware.types.control import ControlState
from swarmware.types.scalar import Float
from swarmware.types.vehicle import GnssFix, Goal, Imu, Pose, Range, VehicleState

T = TypeVar("T", bound=msgspec.Struct)

NEW_PLATFORMS_EVERY = 20
"""Calls of `feed` between two checks for new platforms."""


class Fresh(Generic[T]):
    """A board reader that returns each value once."""

    __slots__ = ("_last", "reader")

    def __init__(self, reader: BoardReader[T]) -> None:
        self.reader = reader
        self._last: T | None = None

    def take(self) -> T | None:
        """The newest value; None when it was returned before."""
        value = self.reader.value
        if value is None or value is self._last:
            return None
        self._last = value
        return value


class Inputs:
    """All inputs of the navigator; a board needs no writer yet."""

    def __init__(self, m: Module) -> None:
        self._others: dict[str, Fresh[Pose]] = {}
        self._calls = 0
        self._gnss = Fresh(m.reader("sensor/gnss", GnssFix))
        self._imu = Fresh(m.reader("sensor/imu", Imu))
        self._scan = Fresh(m.reader("sensor/range", Range))
        self._height = Fresh(m.reader("sensor/height", Float))
        self._vehicle = Fresh(m.reader("vehicle/state", VehicleState))
        self._control = Fresh(m.reader("control/state", ControlState))
        self._goal = Fresh(m.reader("nav/goal", Goal))
        self._poses: BoardSet[Pose] = m.readers("/*/nav/pose", Pose)

    def feed(self, navigator: NavigatorCore, now_ns: int) -> None:
        """Passes all new values to the navigator."""
        if (fix := self._gnss.take()) is not None:
            navigator.on_gnss(fix, self._gnss.reader.stamp_ns or now_ns)
        if (imu := self._imu.take()) is not None:
            navigator.on_imu(imu, self._imu.reader.stamp_ns or now_ns)
        if (scan := self._scan.take()) is not None:
            navigator.on_scan(scan, self._scan.reader.stamp_ns or now_ns)
        if (height := self._height.take()) is not None:
            navigator.on_height(height.value)
        if (vehicle := self._vehicle.take()) is not None:
            navigator.on_vehicle(vehicle)
        if (control := self._control.take()) is not None:
            navigator.on_control(control)
        if (goal := self._goal.take()) is not None:
            navigator.on_goal(goal, now_ns)
        if navigator.resting:
            self._calls = 0  # nothing is avoided at rest; the first step after it reads all of them
            return
        if self._calls % NEW_PLATFORMS_EVERY == 0:
            self._add_platforms()
        self._calls += 1
        for platform, board in self._others.items():
            if (pose := board.take()) is not None:
                # until the sender's clock is converted the value is stamped at its arrival
                age_s = board.reader.age_s or 0.0
                navigator.on_neighbour(platform, pose, now_ns - round(max(age_s, 0.0) * 1e9))

    def _add_platforms(self) -> None:
        for platform, reader in self._poses.items():
            if platform not in self._others:
                self._others[platform] = Fresh(reader)
