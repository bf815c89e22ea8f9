"""Observed states of a vehicle."""

from swarmctl.vehicles.snapshot import VehicleSnapshot
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase, MissionState
from swarmware.types.navigation import NavState, NavStatus
from swarmware.types.vehicle import Pose, VehicleState

DOWN = VehicleState(False, True)


UP = VehicleState(True, False)


HOLDING = NavStatus(3, NavState.HOLDING)


def sight(
    state: str = "done",
    vehicle: VehicleState | None = DOWN,
    kind: str = "uav",
    nav: NavStatus | None = HOLDING,
    pose: Pose | None = Pose.planar(0.0, 0.0),  # noqa: B008 - frozen
    home: Pose | None = None,
) -> VehicleSnapshot:
    return VehicleSnapshot(
        PlatformKind(kind), MissionState(7, "00112233", MissionPhase(state)), vehicle, nav, pose, home
    )
