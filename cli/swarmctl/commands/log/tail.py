"""Follows the log: new entries of one logger, or of all on this machine."""

import asyncio
import contextlib
import math
import time
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log.entries import absolute, show
from swarmctl.commands.log.interleaving import Interleaving
from swarmctl.session import labs
from swarmctl.session.session import config_dir, local_config_dirs
from swarmctl.terminal.output import Output
from swarmware.errors import NotFound
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.model.config import load_node
from swarmware.model.names import Pattern
from swarmware.module.board import BoardReader
from swarmware.module.client import Client
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.ring import segments
from swarmware.recorder.segment import SegmentReader
from swarmware.types.log import LogStats


def follow_entries(pattern: str, count: int | None, out: Output) -> None:
    """Prints new entries that match; ends after `count`, when one is given.

    Raises: as `follow`.
    """
    asyncio.run(follow(out.settings, pattern, partial(show, out), count))


async def follow(
    settings: CliSettings, pattern: str, take: Callable[[LogEntry], None], count: int | None
) -> None:
    """Passes on new entries in the order of the loggers' wall clock; ends after `count`, when given.

    Raises: NotFound without a node whose log is on this machine.
    """
    matcher = Pattern(absolute(pattern, settings))
    left = math.inf if count is None else count
    # in one task: a signal cancels the task that has joined the nodes
    async with Tail(_folders(settings)) as tail:
        while True:
            for entry in await tail.next():
                if matcher.matches(entry.topic):
                    take(entry)
                    left -= 1
                    if left == 0:
                        return


def _folders(settings: CliSettings) -> list[Path]:
    """Configuration folders of the nodes that are followed: of the named node, else of its whole lab."""
    chosen = local_config_dirs(settings)
    if not settings.node and settings.config_dir is None:
        lab = labs.of_station(config_dir(settings))
        if lab is not None:
            return [node.config_dir for node in lab.nodes if node.alive()]
    return list(chosen.values())


class Tail:
    """Waits for the reports of the loggers, then reads the new entries of their segments."""

    def __init__(self, folders: list[Path]) -> None:
        self._growing = {folder: SegmentFollower(_log_dir(folder)) for folder in folders}
        self._order = Interleaving(map(str, folders), utc_ns(), time.monotonic_ns())
        self._stack = AsyncExitStack()
        self._news = asyncio.Event()

    async def __aenter__(self) -> Self:
        """Join the nodes whose logs are shown."""
        async with AsyncExitStack() as stack:
            for folder, growing in self._growing.items():
                module = await stack.enter_async_context(Client("swarmctl", config_dir=folder))
                stats = module.reader("log/stats", LogStats)
                module.start(self._read(str(folder), stats, growing), "tail")
            # kept only when every node was joined; before that an error leaves those already joined
            self._stack = stack.pop_all()
        return self

    async def _read(self, logger: str, stats: BoardReader[LogStats], growing: "SegmentFollower") -> None:
        async for report in stats:
            self._order.on_batch(logger, growing.entries(), report.complete_utc_ns, time.monotonic_ns())
            self._news.set()

    async def next(self) -> list[LogEntry]:
        """The next entries in order, as soon as there are some."""
        while not (ready := self._order.ready(now_ns := time.monotonic_ns())):
            deadline_ns = self._order.deadline_ns(now_ns)
            self._news.clear()
            # at the deadline a logger has not reported for long: the entries of the others are shown
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(None if deadline_ns is None else (deadline_ns - now_ns) / 1e9):
                    await self._news.wait()
        return ready

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the nodes that were joined."""
        await self._stack.__aexit__(kind, error, trace)


def _log_dir(folder: Path) -> Path:
    log_dir = paths.log(load_node(folder).data_path)
    if not log_dir.is_dir():
        raise NotFound(f"log folder {log_dir}: no such folder; expected the logger of that node to run")
    return log_dir


class SegmentFollower:
    """Follows the segments of one logger, from the current one on."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        # only the newest segment grows
        self._readers = [SegmentReader(path) for path in segments(directory)[-1:]]

    def entries(self) -> Iterator[LogEntry]:
        """Entries that no earlier call has returned."""
        last = int(self._readers[-1].path.stem) if self._readers else -1
        # listed before reading: a segment with a successor gets no further entries
        newer = [SegmentReader(path) for path in segments(self._directory) if int(path.stem) > last]
        readers = self._readers + newer
        # older segments are read once more below, then never again
        self._readers = readers[-1:]
        for reader in readers:
            with contextlib.suppress(FileNotFoundError):  # the ring has deleted it
                yield from reader.entries()
