"""The controllers of ground and air vehicles, behind one interface."""

from typing import TYPE_CHECKING, Protocol

from swarmd.navigator.config import Config
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.vehicle import Pose, Setpoint

if TYPE_CHECKING:
    from swarmware.model.airframe import Airframe


class Controller(Protocol):
    """Interface of a controller: from target and obstacles to a set-point.

    `circle_m`: radius of the circle that it flies around a target instead of stopping there, else 0;
    `arrive_m`: smallest arrival radius; `hold_at`: where it holds when it is to stop now;
    `sink`: set-point of a descent without a position.
    """

    free: bool

    @property
    def flies(self) -> bool: ...
    @property
    def circle_m(self) -> float: ...
    @property
    def arrive_m(self) -> float: ...
    def set_config(self, config: Config) -> None: ...
    def stop(self) -> Setpoint: ...
    def sink(self, rate_m_s: float) -> Setpoint: ...
    def hold_at(self, pose: Pose) -> tuple[float, float]: ...
    def descend(self, pose: Pose, stay: Target, speed_m_s: float) -> Target: ...
    def steer(self, pose: Pose, target: Target, around: Surroundings, now_ns: int) -> Setpoint: ...


def controller(kind: PlatformKind, config: Config, airframe: "Airframe | None" = None) -> Controller:
    """The controller for a kind of platform, and for its airframe if that cannot stop in the air."""
    if kind == PlatformKind.UAV:
        if airframe is not None and airframe.type == "fixed_wing":
            from swarmd.navigator.core.circling_controller import CirclingController  # others do not load it

            return CirclingController(config, airframe)
        from swarmd.navigator.core.air_controller import AirController  # a ground vehicle does not load it

        return AirController(config)
    from swarmd.navigator.core.ground_controller import GroundController  # an air vehicle does not load it

    return GroundController(config)
