"""Sources of pictures: a recording, or a stream of images on the node."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from swarmd.video.codec import pyav
from swarmd.video.config import VideoSource
from swarmware.errors import InvalidInput
from swarmware.module.module import Module
from swarmware.types.perception import Image


class StreamSource:
    """Source that reads the newest image of a stream on the node."""

    def __init__(self, module: Module, path: str, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self._reader = module.stream_reader(path, Image)
        self._end: Callable[[], None] = lambda: module.close_reader(self._reader)

    async def next(self) -> Image:
        """The newest image; older waiting images are skipped."""
        image = await self._reader.next()
        # a slow encoder falls behind by skipping, not by a growing delay
        while (newer := self._reader.take()) is not None:
            image = newer
        return image

    def close(self) -> None:
        """Closes the reader of the stream."""
        self._end()


class RecordedVideo:
    """Recording that PyAV reads in the thread of its session; it restarts at its end."""

    def __init__(self, path: str) -> None:
        """Raises: InvalidInput for a file without video."""
        self._path = path
        self._av = pyav()
        try:
            self._container: Any = self._av.open(path)
            stream = self._container.streams.video[0]
        except (OSError, IndexError, self._av.FFmpegError) as error:
            raise InvalidInput(f"{path}: {error}; expected a file with video") from error
        rate = stream.average_rate or stream.guessed_rate
        # a recording without a rate counts as 25 Hz, and a damaged header must not stop or flood the
        # session
        self.rate_hz = min(max(float(rate or 25), 1.0), 120.0)
        self._frames = self._container.decode(video=0)

    def read(self) -> Any:
        """The next frame of PyAV. Raises: InvalidInput for a file without frames."""
        # the second attempt reads from the begin; a file without pictures fails then
        for _ in range(2):
            try:
                return next(self._frames)
            except StopIteration:
                self._container.seek(0)
                self._frames = self._container.decode(video=0)
            except self._av.FFmpegError as error:
                raise InvalidInput(f"{self._path}: {error}") from error
        raise InvalidInput(f"{self._path}: no pictures")

    def close(self) -> None:
        """Closes the file of the recording."""
        self._container.close()


class FileSource:
    """Source that reads the pictures of a recording at its own rate."""

    def __init__(self, module: Module, recording: RecordedVideo, executor: Executor) -> None:
        self.rate_hz = recording.rate_hz
        self._recording = recording
        self._executor = executor
        self._ticks = module.every(1 / self.rate_hz)

    async def next(self) -> Any:
        """The next picture, when it is due."""
        await anext(self._ticks)
        return await asyncio.get_running_loop().run_in_executor(self._executor, self._recording.read)

    def close(self) -> None:
        """Closes the file after the picture that is being read."""
        self._executor.submit(self._recording.close)


PictureSource = StreamSource | FileSource
"""A source of pictures with a rate."""


async def open_source(
    module: Module, name: str, source: VideoSource | None, executor: Executor
) -> PictureSource:
    """Opens a configured source, or the stream of images at the path `name` if `source` is None.

    Raises: InvalidInput.
    """
    if source is not None and source.file:
        recording = await asyncio.get_running_loop().run_in_executor(executor, RecordedVideo, source.file)
        return FileSource(module, recording, executor)
    source = source or VideoSource(resource=name)
    return StreamSource(module, source.resource, source.rate_hz)
