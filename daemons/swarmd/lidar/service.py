"""The service of the lidar: one thread decodes packets, another one models the obstacles (S0.44)."""

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Final, TypeVar

from swarmd.lidar import config as settings
from swarmd.lidar.core.obstacle_model import ObstacleModel
from swarmd.lidar.core.turn_decoder import Turn, TurnDecoder
from swarmware.geometry.attitude import LEVEL, to_euler
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.service.service import Service
from swarmware.types.perception import PointCloud, PointField
from swarmware.types.scalar import Blob
from swarmware.types.vehicle import Pose, Range

BATCH: Final = 16
"""Number of packets that are decoded together, 21 ms of a VLP-16."""
POINT: Final = PointCloud(
    tuple(PointField(name, 4 * index, "f4") for index, name in enumerate(("x", "y", "z"))), 12, b""
)
CLOUD_BYTES: Final = 1 << 20
R = TypeVar("R")

log = logging.getLogger("swarm.lidar")


class Lidar(Service):
    """Publishes the distances to obstacles that a rotating lidar sees."""

    name = "lidar"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        """Raises: NotFound without NumPy."""
        super().__init__(module, config)
        self._decoder = TurnDecoder(config.forward_deg)
        self._model = ObstacleModel(config)
        self._packets = module.stream_reader(config.packets, Blob)
        self._pose = module.reader("nav/pose", Pose)
        self._ranges: BoardWriter[Range] = module.writer(
            config.ranges, Range, rate_hz=10.0, link="request", description="Distances to obstacles around"
        )
        self._cloud: BoardWriter[PointCloud] | None = None
        if config.points:
            self._cloud = module.stream_writer(
                config.points, PointCloud, rate_hz=10.0, link="request", slot_bytes=CLOUD_BYTES
            )
        self._decoding = ThreadPoolExecutor(1, "lidar-points")
        self._modelling = ThreadPoolExecutor(1, "lidar-obstacles")
        self._turns: asyncio.Queue[Turn] = asyncio.Queue(2)
        self._refused = 0

    async def run(self) -> None:
        """Decodes and models until the service ends; each in a thread, at the same time."""
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._decode(), name="lidar:packets")
                group.create_task(self._follow_obstacles(), name="lidar:obstacles")
        finally:
            for executor in (self._decoding, self._modelling):
                executor.shutdown(wait=False, cancel_futures=True)

    async def _decode(self) -> None:
        packets: list[bytes] = []
        while True:
            packets.append((await self._packets.next()).value)
            meta = self._packets.meta
            if len(packets) < BATCH or meta is None:
                continue
            batch, packets, stamp_ns = packets, [], meta.stamp_ns
            turns = await in_thread(self._decoding, partial(self._decoder.turns, batch, stamp_ns))
            for turn in turns:
                if self._turns.full():
                    self._turns.get_nowait()  # avoidance needs the newest turn; an older one is dropped
                self._turns.put_nowait(turn)
            if self._decoder.refused != self._refused:
                self._refused = self._decoder.refused
                log.warning(
                    "%s: %d packets or blocks are not of a VLP-16", self.config.packets, self._refused
                )

    async def _follow_obstacles(self) -> None:
        while True:
            turn = await self._turns.get()
            pose = self._pose.value
            attitude = LEVEL if pose is None else (pose.qx, pose.qy, pose.qz, pose.qw)
            roll, pitch, _ = to_euler(attitude)
            ranges = partial(self._model.ranges, turn.points, roll, pitch)
            self._ranges.write(await in_thread(self._modelling, ranges), turn.stamp_ns)
            if self._cloud is not None:
                points = turn.points.astype("<f4").tobytes()
                self._cloud.write(PointCloud(POINT.fields, POINT.point_bytes, points), turn.stamp_ns)


async def in_thread(executor: ThreadPoolExecutor, function: Callable[[], R]) -> R:
    """Runs a function in a worker thread, and returns its result."""
    return await asyncio.get_running_loop().run_in_executor(executor, function)
