"""Interface of the controllers of ground and air vehicles, and their choice."""

from typing import TYPE_CHECKING, Protocol

from swarmd.navigator.config import Config
from swarmd.navigator.core.target import Surroundings, Target
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.vehicle import Pose, Setpoint

if TYPE_CHECKING:
    from swarmware.model.airframe import Airframe


class Controller(Protocol):
    """Interface of a controller, which computes a set-point from target and obstacles.

    `circle_m`: radius of the circle around a target for a vehicle that cannot stop there, else 0;
    `arrive_m`: minimum arrival radius; `hold_at`: position at which the vehicle holds when it is to stop now;
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
    """Creates the controller for a kind of platform; a fixed-wing airframe has its own controller."""
    if kind == PlatformKind.UAV:
        if airframe is not None and airframe.type == "fixed_wing":
            from swarmd.navigator.core.circling_controller import CirclingController  # not loaded by others

            return CirclingController(config, airframe)
        from swarmd.navigator.core.air_controller import AirController  # not loaded by a ground vehicle

        return AirController(config)
    from swarmd.navigator.core.ground_controller import GroundController  # not loaded by an air vehicle

    return GroundController(config)
