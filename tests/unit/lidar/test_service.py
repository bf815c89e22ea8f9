"""The lidar service on a node: two threads of its own, distances and points on the node, garbage refused."""

import asyncio
import logging
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from tests.unit.lidar.packets import recording, turn, wall

from swarmd.lidar.config import Config
from swarmd.lidar.service import Lidar
from swarmware.geometry.attitude import from_euler
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.perception import PointCloud
from swarmware.types.scalar import Blob
from swarmware.types.vehicle import Pose, Range


class Bench:
    """The service, a driver that writes packets, and a reader of the distances."""

    def __init__(self, other: Module) -> None:
        self.other = other
        self.driver: BoardWriter[Blob] = other.stream_writer(
            "sensor/lidar", Blob, slots=4096, slot_bytes=1400
        )
        self.ranges = other.reader("sensor/range", Range)

    def send(self, packets: list[bytes], stamp_ns: int | None = None) -> None:
        for packet in packets:
            self.driver.write(Blob(packet), stamp_ns)


@asynccontextmanager
async def bench(root: Path, config: Config | None = None) -> AsyncIterator[Bench]:
    async with (
        tmp_node(root) as node,
        Module("lidar", node=node) as module,
        Module("test", node=node) as other,
    ):
        made = Bench(other)
        service = asyncio.create_task(Lidar(module, config or Config()).run())
        try:
            yield made
        finally:
            service.cancel()
            with suppress(asyncio.CancelledError):
                await service


async def test_distances_follow_a_recording_and_two_threads_work(tmp_path: Path) -> None:
    async with bench(tmp_path, Config(points="sensor/points")) as made:
        clouds = made.other.stream_reader("sensor/points", PointCloud)
        made.send(recording()[:320], 5_000_000_000)
        async with asyncio.timeout(20.0):
            scan = await made.ranges.changed()
            cloud = await clouds.next()
        assert made.ranges.stamp_ns == 5_000_000_000, "the instant of the packets, not of the computation"
        assert len(scan.ranges_m) == 36
        assert min(scan.ranges_m) >= 0.9
        assert max(scan.ranges_m) <= 100.0
        rows = np.frombuffer(cloud.points, "<f4").reshape(-1, 3)
        assert len(rows) > 5_000
        assert [field.name for field in cloud.fields] == ["x", "y", "z"]
        names = {thread.name.rsplit("_", 1)[0] for thread in threading.enumerate()}
        assert {"lidar-points", "lidar-obstacles"} <= names


async def test_attitude_of_vehicle_makes_points_level(tmp_path: Path) -> None:
    async with bench(tmp_path) as made:
        pose: BoardWriter[Pose] = made.other.writer("nav/pose", Pose)
        q = from_euler(0.0, 0.5, 0.0)
        pose.write(Pose(0.0, 0.0, 0.0, *q))
        made.send(turn(wall(5.0)) * 2)
        async with asyncio.timeout(20.0):
            scan = await made.ranges.changed()
        # 29 degrees nose down, the lower half of the wall is below the ground
        assert scan.ranges_m[0] > 4.4
        assert scan.ranges_m[0] != pytest.approx(5.0, abs=0.05)


async def test_foreign_bytes_are_logged_and_turn_seen(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "swarm.lidar"):
        async with bench(tmp_path) as made:
            made.send([b"garbage"] * 16)
            made.send(turn(wall(5.0)) * 2)
            async with asyncio.timeout(20.0):
                scan = await made.ranges.changed()
            assert scan.ranges_m[0] == pytest.approx(5.0, abs=0.05)
    assert "sensor/lidar: 16 packets or blocks are not of a VLP-16" in caplog.text
