"""The fence of this vehicle: evaluates it by the pose, publishes `nav/fence`, and refuses targets outside."""

from typing import Final

from swarmd.mission.core.fence import Geofence, area_of, needs_origin, targets
from swarmd.mission.fence_config import FenceConfig
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.geometry.polygon import Point
from swarmware.mission.model import MissionDefinition
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.fence import FenceState, MapOrigin
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.vehicle import Pose, VehicleState

PERIOD_S: Final = 0.2
"""Period of the evaluation: a vehicle of 10 m/s moves 2 m in it."""
REPEAT_NS: Final = 1_000_000_000
"""Period of `nav/fence` while the vehicle is disarmed."""
POSE_S: Final = 1.5
"""Age above which the pose is not known: at rest it comes five times a second."""


class FenceWatch:
    """Evaluates the fence while the daemon runs."""

    def __init__(self, module: Module, config: FenceConfig | None) -> None:
        self._module = module
        self._config = config
        self._pose = module.reader("nav/pose", Pose)
        self._state = module.reader("vehicle/state", VehicleState)
        self._goal = module.reader("nav/goal", Goal)
        self._origins = module.reader("nav/origin", MapOrigin)
        self._origin: MapOrigin | None = None
        """Origin for which the fence was placed in the map."""
        self._fence: Geofence | None = None
        if config is not None and not needs_origin(config):
            self._fence = Geofence(config, area_of(config, None))
        self._written_ns = 0
        self._board: BoardWriter[FenceState] = module.writer(
            "nav/fence", FenceState, log="1hz", description="Geofence, and where the vehicle is to it"
        )
        if config is None:  # written once, so that readers distinguish it from an absent daemon
            self._board.write(FenceState(False))

    async def run(self, config: FenceConfig) -> None:
        """Evaluate the fence until cancelled."""
        async for _ in self._module.every(PERIOD_S):
            now_ns = self._module.now_ns()
            vehicle = self._state.value
            armed = vehicle is not None and vehicle.armed
            if armed or now_ns - self._written_ns >= REPEAT_NS:
                self._written_ns = now_ns
                self._board.write(self._evaluate(config, vehicle), now_ns)

    def refusal(self, mission: MissionDefinition) -> str:
        """Reason to refuse a mission, with its targets outside the fence, or "" if it is accepted."""
        if self._config is None:
            return ""
        found = [
            f"{name}: {reason}"
            for name, place, z_m in targets(mission, self._module.platform)
            if (reason := self.why_not(place, z_m))
        ]
        return "; ".join(found)

    def why_not(self, place: Point | None, z_m: float | None) -> str:
        """Reason to refuse a target, or "" if it is within all limits or there is no fence.

        `place`: None for a target that is only a height; `z_m`: None for a target that keeps its height.
        """
        if self._config is None:
            return ""
        fence = self._placed(self._config)
        return (
            "the fence is not known: no origin of the map (nav/origin)"
            if fence is None
            else fence.why_not(place, z_m)
        )

    def _placed(self, config: FenceConfig) -> Geofence | None:
        """The fence in the map, or None while the origin of the map is not known."""
        if needs_origin(config) and (origin := self._origins.value) is not None and origin != self._origin:
            self._origin = origin
            local_map = LocalMap(
                Origin(lat_deg=origin.lat_deg, lon_deg=origin.lon_deg, alt_ellipsoid_m=origin.alt_ellipsoid_m)
            )
            self._fence = Geofence(config, area_of(config, local_map))
        return self._fence

    def _evaluate(self, config: FenceConfig, vehicle: VehicleState | None) -> FenceState:
        fence, pose, age_s = self._placed(config), self._pose.value, self._pose.age_s
        if fence is None:
            return _unknown(config, "no origin of the map (nav/origin)")
        if pose is None or age_s is None:
            return _unknown(config, "no pose (nav/pose)")
        if age_s > POSE_S:
            return _unknown(config, f"no pose (nav/pose) for {age_s:.1f} s")
        goal = self._goal.value
        return fence.state(
            pose,
            landed=vehicle is None or vehicle.landed,  # an unknown vehicle has no lowest height
            landing=goal is not None and goal.kind is GoalKind.LAND,
        )


def _unknown(config: FenceConfig, note: str) -> FenceState:
    return FenceState(True, min_height_m=config.min_height_m, max_height_m=config.max_height_m, note=note)
