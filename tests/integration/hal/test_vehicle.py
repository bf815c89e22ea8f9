"""A vehicle as real processes: simulated devices, drivers, navigator; killed and back again."""

import asyncio
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from tests.integration.hal.nodes import VEHICLE, node
from tests.patience import PATIENCE_S

from swarmd.hal.config import Config as HalConfig
from swarmd.sim.config import BatteryConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.errors import Denied, SwarmError
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.types.driver import DriverTable
from swarmware.types.navigation import Goal, GoalKind, NavStatus
from swarmware.types.scalar import Blob, Float
from swarmware.types.system import SystemLoad
from swarmware.types.vehicle import ArmRequest, BatteryState, GnssFix, Imu, Pose, Range, VehicleState

ARM = "sys/vehicle/arm"


async def until(
    board: BoardReader[NavStatus], right: Callable[[NavStatus], bool], timeout_s: float = PATIENCE_S
) -> None:
    async with asyncio.timeout(timeout_s):
        while board.value is None or not right(board.value):
            await board.changed()


def test_a_multirotor_takes_off_and_lands(tmp_path: Path) -> None:
    async def fly() -> None:
        config_dir = node(tmp_path, "uav1")
        async with spawn(config_dir, *VEHICLE), Module("test", config_dir=config_dir) as m:
            goals = m.writer("nav/goal", Goal)
            status = m.reader("nav/status", NavStatus)
            truth = m.reader("sim/truth", Pose)
            pose = m.reader("nav/pose", Pose)
            await m.reader("sensor/gnss", GnssFix).changed(timeout_s=PATIENCE_S)
            await m.reader("sensor/imu", Imu).changed(timeout_s=PATIENCE_S)
            await m.reader("sensor/range", Range).changed(timeout_s=PATIENCE_S)
            await m.reader("sensor/height", Float).changed(timeout_s=PATIENCE_S)
            await m.reader("power/battery", BatteryState).changed(timeout_s=PATIENCE_S)
            await m.reader("system/load", SystemLoad).changed(timeout_s=PATIENCE_S)
            await m.reader("hal/drivers", DriverTable).changed(timeout_s=PATIENCE_S)
            await pose.changed(timeout_s=PATIENCE_S)
            with pytest.raises(Denied, match="in the air"):
                assert (await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)).armed
                goals.write(Goal(1, GoalKind.TAKEOFF, z_m=3.0, speed_m_s=1.5))
                await until(status, lambda s: s.goal_seq == 1 and s.state == "arrived")
                await m.request(ARM, ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)
            assert truth.value is not None
            assert pose.value is not None
            assert truth.value.z_m == pytest.approx(3.0, abs=0.5)
            assert pose.value.x_m == pytest.approx(truth.value.x_m, abs=0.2)
            goals.write(Goal(2, GoalKind.LAND))
            await until(status, lambda s: s.goal_seq == 2 and s.state == "arrived")
            assert (await m.request(ARM, ArmRequest(False), VehicleState, timeout_s=PATIENCE_S)).landed

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_a_surface_vessel_goes_where_it_is_sent(tmp_path: Path) -> None:
    async def sail() -> None:
        config_dir = node(tmp_path, "usv1", template="usv")
        async with spawn(config_dir, "tree", *VEHICLE), Module("test", config_dir=config_dir) as m:
            goals = m.writer("nav/goal", Goal)
            status = m.reader("nav/status", NavStatus)
            truth = m.reader("sim/truth", Pose)
            start = await truth.changed(timeout_s=PATIENCE_S)
            assert (await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)).armed
            goals.write(Goal(1, GoalKind.GOTO, x_m=start.x_m + 6.0, y_m=start.y_m + 2.0, speed_m_s=2.0))
            await until(status, lambda s: s.goal_seq == 1 and s.state == "arrived")
            here = truth.value
            assert here is not None
            assert math.dist((here.x_m, here.y_m), (start.x_m + 6.0, start.y_m + 2.0)) < 1.0

    with no_leaks(tmp_path):
        asyncio.run(sail())


def test_failed_simulation_never_reports_ready(tmp_path: Path) -> None:
    async def start() -> None:
        world = tmp_path / "share/worlds/nowhere.toml"
        world.parent.mkdir(parents=True)
        (tmp_path / "share/templates").mkdir()
        bounds = "x_m = [0.0, 1.0]\ny_m = [0.0, 1.0]"
        world.write_text(f'description = ""\n[bounds]\n{bounds}\n[start.uav]\nx_m = 0.0\ny_m = 0.0\n')
        config_dir = node(tmp_path, "usv1", SimConfig(world="nowhere"), share_dir=str(tmp_path / "share"))
        with pytest.raises(SwarmError, match=r"ended with 7 before it was ready[^$]*a rule for uav only"):
            async with spawn(config_dir, "sim"):
                pass

    asyncio.run(start())


def test_arming_with_empty_battery_is_refused_with_reason(tmp_path: Path) -> None:
    async def ask() -> None:
        config_dir = node(tmp_path, "ugv1", SimConfig(battery=BatteryConfig(start_ratio=0.05)))
        async with spawn(config_dir, "sim", "hal"), Module("test", config_dir=config_dir) as m:
            await m.reader("vehicle/state", VehicleState).changed(timeout_s=PATIENCE_S)
            with pytest.raises(Denied, match="battery at 5%, expected at least 15%"):
                await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)

    with no_leaks(tmp_path):
        asyncio.run(ask())


def test_killed_simulation_resumes_where_vehicle_was(tmp_path: Path) -> None:
    async def drive() -> None:
        config_dir = node(tmp_path, "ugv1")
        async with (
            spawn(config_dir, "hal", "control", "navigator"),
            Module("test", config_dir=config_dir) as m,
        ):
            goals = m.writer("nav/goal", Goal)
            status = m.reader("nav/status", NavStatus)
            truth = m.reader("sim/truth", Pose)
            async with spawn(config_dir, "sim") as sim:
                start = await truth.changed(timeout_s=PATIENCE_S)
                await m.request(ARM, ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)
                goals.write(Goal(1, GoalKind.GOTO, x_m=start.x_m + 6.0, y_m=start.y_m, speed_m_s=2.0))
                await until(status, lambda s: s.goal_seq == 1 and 0 < s.distance_m < 4.0)
                await sim.kill()
            before = truth.value
            assert before is not None
            async with spawn(config_dir, "sim"):
                after = await truth.changed(timeout_s=PATIENCE_S)
                assert after.x_m == pytest.approx(before.x_m, abs=0.5)
                await until(status, lambda s: s.state == "arrived")

    asyncio.run(drive())


def test_replayed_lidar_sends_753_packets_second_in_order(tmp_path: Path) -> None:
    recording = Path(__file__).parents[3] / "share/swarm/data/vlp16/recording.bin"
    data = recording.read_bytes()
    packets = {data[at : at + 1206]: at // 1206 for at in range(0, len(data), 1206)}

    async def listen() -> None:
        config_dir = node(tmp_path, "ugv1", hal=HalConfig(drivers=("replay",)))
        async with spawn(config_dir, "hal"), Module("test", config_dir=config_dir) as m:
            stream = m.stream_reader("sensor/lidar", Blob)
            indexes: list[int] = []
            stamps: list[int] = []
            lost = 0
            async with asyncio.timeout(PATIENCE_S):
                while len(indexes) < 1600:
                    packet = await stream.next()
                    if stream.lost != lost:  # this process stood still for longer than the ring lasts: again
                        lost = stream.lost
                        indexes.clear()
                        stamps.clear()
                    assert stream.meta is not None
                    indexes.append(packets[packet.value])
                    stamps.append(stream.meta.stamp_ns)
            assert all((b - a) % 1000 == 1 for a, b in pairwise(indexes))
            steps = [b - a for a, b in pairwise(stamps)]
            assert {round(step / 1e9 * 753, 5) for step in steps} == {1.0}

    with no_leaks(tmp_path):
        asyncio.run(listen())


def test_a_device_that_is_missing_is_waited_for(tmp_path: Path) -> None:
    recording = tmp_path / "late.bin"

    async def wait() -> None:
        hal = HalConfig(drivers=("replay", "system"), retry_s=0.2, report_hz=10.0)
        config_dir = node(tmp_path, "ugv1", hal=hal)
        text = (config_dir / "services/hal.toml").read_text()
        (config_dir / "services/hal.toml").write_text(text.replace("vlp16/recording.bin", str(recording)))
        async with spawn(config_dir, "hal"), Module("test", config_dir=config_dir) as m:
            drivers = m.reader("hal/drivers", DriverTable)

            async def state(wanted: str) -> str:
                async with asyncio.timeout(PATIENCE_S):
                    while True:
                        table = await drivers.changed()
                        found = {driver.name: driver for driver in table.drivers}
                        if found["replay"].state == wanted:
                            return found["replay"].note + found["system"].state

            assert "No such file" in await state("failed")
            await asyncio.to_thread(recording.write_bytes, bytes(2412))
            assert await state("running") == "running"
            stream = m.stream_reader("sensor/lidar", Blob)
            assert len((await stream.next(timeout_s=PATIENCE_S)).value) == 1206

    asyncio.run(wait())
