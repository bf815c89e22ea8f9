"""The controllers of ground and air vehicles, behind one interface."""

from typing import Protocol

from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.vehicle import Pose, Setpoint


class Controller(Protocol):
    """Interface of a controller: from target and obstacles to a set-point."""

    free: bool

    @property
    def flies(self) -> bool: ...
    def set_config(self, config: Config) -> None: ...
    def stop(self) -> Setpoint: ...
    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint: ...


def controller(kind: PlatformKind, config: Config) -> Controller:
    """The controller for a kind of platform."""
    if kind == PlatformKind.UAV:
        return AirController(config)
    from swarmd.navigator.core.ground_controller import GroundController  # an air vehicle does not load it

    return GroundController(config)
