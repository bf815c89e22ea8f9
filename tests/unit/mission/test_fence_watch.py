"""The fence in the daemon: it waits for pose and origin of the map, and refuses targets of missions."""

import asyncio
from pathlib import Path

from tests.patience import PATIENCE_S

from swarmd.mission.builtin import manoeuvre
from swarmd.mission.fence_config import FenceConfig
from swarmd.mission.fence_watch import FenceWatch
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.fence import FenceState, MapOrigin
from swarmware.types.vehicle import Pose, VehicleState

ORIGIN = Origin(lat_deg=48.0, lon_deg=11.0, alt_ellipsoid_m=520.0)
CENTRE = LocalMap(ORIGIN).to_wgs84(0.0, 0.0, 0.0)[:2]


async def test_fence_in_degrees_needs_pose_and_origin(tmp_path: Path) -> None:
    config = FenceConfig(centre_deg=CENTRE, radius_m=50.0)
    far = manoeuvre("goto", {"x_m": 60.0, "y_m": 0.0}, "uav1", PlatformKind.UAV)
    near = manoeuvre("goto", {"x_m": 40.0, "y_m": 0.0}, "uav1", PlatformKind.UAV)
    async with (
        tmp_node(tmp_path) as node,
        Module("mission", node=node) as m,
        Module("test", node=node) as other,
    ):
        watch = FenceWatch(m, config)
        board = other.reader("nav/fence", FenceState)
        m.start(watch.run(config), "fence")

        async def until(note: str) -> FenceState:
            async with asyncio.timeout(PATIENCE_S):
                while (state := board.value) is None or state.note != note:
                    await board.changed()
            return state

        assert (await until("no origin of the map (nav/origin)")).inside is None
        assert "no origin of the map" in watch.refusal(near)
        origin = other.writer("nav/origin", MapOrigin)
        origin.write(MapOrigin(ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.alt_ellipsoid_m))
        assert (await until("no pose (nav/pose)")).leaving is None
        assert watch.refusal(near) == ""
        assert watch.refusal(far) == "Goto goto: 10.0 m outside the boundary of the fence"
        other.writer("vehicle/state", VehicleState).write(VehicleState(True, False))
        other.writer("nav/pose", Pose).write(Pose(45.0, 0.0, 5.0))
        state = await until("")
        assert (state.exists, state.inside, state.limit) == (True, True, "area")


async def test_vehicle_without_fence_says_so_and_refuses_nothing(tmp_path: Path) -> None:
    far = manoeuvre("goto", {"x_m": 9000.0, "y_m": 0.0}, "uav1", PlatformKind.UAV)
    async with (
        tmp_node(tmp_path) as node,
        Module("mission", node=node) as m,
        Module("test", node=node) as other,
    ):
        watch = FenceWatch(m, None)
        assert other.reader("nav/fence", FenceState).value == FenceState(False)
        assert watch.refusal(far) == ""
