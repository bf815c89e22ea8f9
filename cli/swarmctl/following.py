"""The record as it grows: entries from now on, of one logger or of all on this machine."""

import asyncio
from collections.abc import Iterator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Final

from swarmctl.connect import config_dir, folder_asked
from swarmctl.lab import record as labs
from swarmctl.records import absolute
from swarmctl.settings import Settings
from swarmware.config import load_node
from swarmware.errors import NotFound
from swarmware.module import BoardReader, Module
from swarmware.names import Pattern
from swarmware.record.entry import Entry
from swarmware.record.ring import segments
from swarmware.record.segment import SegmentReader
from swarmware.types.log import LogStats

BATCHES: Final = 64
"""Batches read and not yet printed; beyond it reading waits, and the files keep what comes."""


def follow(settings: Settings, pattern: str) -> Iterator[Entry]:
    """Entries from now on that match, as the loggers end their batches.

    Raises: NotFound without a node whose record is on this machine.
    """
    matcher = Pattern(absolute(pattern, settings))
    with asyncio.Runner() as runner:
        tail = Tail()
        try:
            runner.run(tail.open(_folders(settings)))
            while True:
                yield from (entry for entry in runner.run(tail.next()) if matcher.matches(entry.topic))
        finally:
            runner.run(tail.close())


def _folders(settings: Settings) -> list[Path]:
    """Configuration folders of the nodes that are followed: the one asked about, else all of its lab."""
    joined = folder_asked(settings)
    if not settings.node and settings.config_dir is None:
        for lab in labs.labs():
            if lab.station.config_dir == config_dir(settings):
                return [node.config_dir for node in lab.nodes if node.alive()]
    return [joined]


class Tail:
    """Waits on the loggers' own reports, then reads what is new in their segments."""

    def __init__(self) -> None:
        self._stack = AsyncExitStack()
        self._batches: asyncio.Queue[list[Entry]] = asyncio.Queue(BATCHES)

    async def open(self, folders: list[Path]) -> None:
        """Joins the nodes; what is recorded already was not asked for."""
        for folder in folders:
            log_dir = load_node(folder).data_path / "log"
            if not log_dir.is_dir():
                raise NotFound(f"log folder {log_dir}: not there; expected the logger of that node to run")
            module = await self._stack.enter_async_context(Module("swarmctl", config_dir=folder))
            stats = await module.reader("log/stats", LogStats)
            growing = Growing(log_dir)

            async def read(stats: BoardReader[LogStats] = stats, growing: Growing = growing) -> None:
                async for _ in stats:
                    if fresh := growing.entries():
                        await self._batches.put(fresh)

            module.start(read(), "tail")

    async def next(self) -> list[Entry]:
        """What one logger wrote."""
        return await self._batches.get()

    async def close(self) -> None:
        """Leaves the nodes."""
        await self._stack.aclose()


class Growing:
    """Segments of one logger from their present end."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._reader: SegmentReader | None = None
        if paths := segments(directory):
            self._reader = SegmentReader(paths[-1])
            for _ in self._reader.entries():
                pass

    def entries(self) -> list[Entry]:
        """What has come since the last call."""
        out = list(self._reader.entries()) if self._reader is not None else []
        last = int(self._reader.path.stem) if self._reader is not None else -1
        for path in segments(self._directory):
            if int(path.stem) > last:
                self._reader = SegmentReader(path)
                out += self._reader.entries()
        return out
