"""Boards that the navigator, the estimator and the guidance write, and the live settings."""

from collections.abc import Mapping
from typing import Final

from swarmd.navigator.config import Config
from swarmware.geometry.geodesy import Origin
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.fence import MapOrigin
from swarmware.types.navigation import NavStatus
from swarmware.types.placement import InputDelays
from swarmware.types.vehicle import Pose, Setpoint

LIVE_SETTINGS: Final[Mapping[str, str]] = {
    "dwa.heading_weight": "navigator/heading_weight",
    "dwa.distance_weight": "navigator/distance_weight",
    "dwa.velocity_weight": "navigator/velocity_weight",
    "altitude.kp_1_s": "navigator/altitude_kp",
    "altitude.ki_1_s2": "navigator/altitude_ki",
    "altitude.kd": "navigator/altitude_kd",
    "air.kp_1_s": "navigator/position_kp",
}
"""Gains of the guidance that can be changed at run time."""


def pose_writer(module: Module, config: Config) -> BoardWriter[Pose]:
    """Creates the writer of the estimated pose."""
    return module.writer("nav/pose", Pose, rate_hz=config.rate_hz, description="Estimated pose and velocity")


def delay_writer(module: Module, path: str) -> BoardWriter[InputDelays]:
    """Creates the writer of the delays of an input from another computer."""
    return module.writer(
        path,
        InputDelays,
        link="request",
        log="all",
        description="Delays of an input from another computer",
    )


def publish_origin(module: Module, origin: Origin) -> None:
    """Publishes the origin of the map, to which poses and goals refer."""
    board = module.writer(
        "nav/origin", MapOrigin, log="all", description="Geodetic position of the map's origin"
    )
    board.write(MapOrigin(origin.lat_deg, origin.lon_deg, origin.alt_ellipsoid_m))


class GuidanceWriters:
    """Writers of the guidance's set-point and status."""

    def __init__(self, module: Module, config: Config) -> None:
        self._log = module.log
        self._setpoints = module.writer(
            "act/setpoint", Setpoint, rate_hz=config.rate_hz, description="Set-point of velocity and yaw rate"
        )
        self._statuses = module.writer(
            "nav/status", NavStatus, rate_hz=config.status_hz, description="Progress towards the goal"
        )

    def write(self, setpoint: Setpoint, status: NavStatus | None, now_ns: int) -> None:
        """Publishes the outputs of one step."""
        self._setpoints.write(setpoint, now_ns)
        if status is not None:
            self._statuses.write(status, now_ns)
            self._log.debug("goal %d: %s", status.goal_seq, status.state)

    def stop(self) -> None:
        """Publishes a last set-point, which stops the vehicle."""
        self._setpoints.write(Setpoint(0.0))
