"""Video daemons beside the brokers of a swarm, with a real recording as source."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.integration.broker.swarm import Station
from tests.patience import PATIENCE_S, until_answer

from swarmd.video.config import Config, VideoSource
from swarmd.video.service import Video
from swarmware.module.module import Module
from swarmware.types.rpc import Empty
from swarmware.types.video import VideoSession, VideoSessions

pytest.importorskip("av", reason="video needs PyAV: the extra `video` is not installed")

RECORDING = Path(__file__).parents[2] / "data" / "video" / "bikes.mp4"
"""60 pictures of 640 x 272 at 25 Hz."""
SIZE = (640, 272)


@asynccontextmanager
async def video(station: Station, **settings: Any) -> AsyncIterator[None]:
    """The video daemon of a node, whose source `camera` is the recording."""
    config = Config(sources={"camera": VideoSource(file=str(RECORDING))}, **settings)
    async with AsyncExitStack() as stack:
        module = await stack.enter_async_context(Module("video", node=station.node, config=config))
        task = asyncio.create_task(Video(module, config).run(), name=f"video {station.platform}")
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


async def sessions(station: Station, path: str = "sys/video/ls") -> tuple[VideoSession, ...]:
    """The sessions of a node."""
    found = await station.app.request(path, Empty(), VideoSessions, timeout_s=PATIENCE_S)
    return found.sessions


async def until(
    station: Station, what: Callable[[tuple[VideoSession, ...]], bool]
) -> tuple[VideoSession, ...]:
    """Waits until the sessions of a node fulfil a condition; requests them once a second."""
    return await until_answer(lambda: sessions(station), what)
