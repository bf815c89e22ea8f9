"""Common parts of the logger's tests: events in a database, and the state of the upload."""

import asyncio
import contextlib
from pathlib import Path
from typing import Any

from tests.patience import PATIENCE_S

from swarmware.errors import SwarmError
from swarmware.module.module import Module
from swarmware.module.streamwriter import STREAM_SLOTS
from swarmware.module.writer import BoardWriter
from swarmware.recorder.query import FolderSource, Query
from swarmware.types.health import Fault, FaultList, FaultQuery
from swarmware.types.log import LogStats, LogStatsRequest
from swarmware.types.scalar import Int

CHECK = "logger/mongodb"


async def fault(module: Module) -> Fault:
    """Waits for the monitor's check of the database; returns its state."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with contextlib.suppress(SwarmError):  # the monitor may still start
                found = await module.request("sys/health/faults", FaultQuery(), FaultList)
                for one in found.faults:
                    if one.check == CHECK:
                        return one
            await asyncio.sleep(0.05)


COUNT = "test/count"


def counted(folder: Path, path: str = COUNT) -> list[int]:
    found = (entry.value() for entry in FolderSource([folder]).entries(Query(pattern=f"/uav1/{path}")))
    return [value.value for value in found if isinstance(value, Int)]


async def flushed(module: Module) -> LogStats:
    return await module.request("sys/log/stats", LogStatsRequest(flush=True), LogStats, timeout_s=PATIENCE_S)


def events(module: Module, slots: int = STREAM_SLOTS) -> BoardWriter[Int]:
    return module.stream_writer(COUNT, Int, kind="event", log="all", slots=slots)


async def forwarded(stats: Any, count: int) -> None:
    """Waits until the logger reports that this number of entries is stored and no entry is pending."""
    async for value in stats:
        if value.forwarded >= count and value.backlog == 0:
            return
