"""The logger's shell: looks at shared memory, hands batches to the disk, forwards to MongoDB."""

import asyncio
import errno
import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from swarmd.logger import config as settings
from swarmd.logger.book import GAPS, Batch, Book
from swarmd.logger.core import Plan, Track
from swarmd.logger.taps import LogTap
from swarmd.logger.upload import Upload
from swarmware import paths, template
from swarmware.clock import utc_ns
from swarmware.delivery import sender_of
from swarmware.frame import Frame
from swarmware.module import BoardWriter, Meta, Module
from swarmware.record.address import password_in
from swarmware.record.ring import Repairs
from swarmware.resource import Kind, Resource
from swarmware.service import Service
from swarmware.types.log import LogGap, LogStats, LogStatsRequest

log = logging.getLogger("swarm.logger")

DISK: Final = "disk"
PASSWORD: Final = "mongodb_password"
"""Names of the conditions that `swarmctl health` shows."""
DISK_RETRY_S: Final = 1.0


class Logger(Service):
    """Writes what the resource table says to the local ring, and from there to MongoDB."""

    name = "logger"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        self._node = module.node
        self._table = self._node.table
        self._table_version = -1
        self._plan = Plan()
        self._taps: dict[str, LogTap] = {}
        self._batch = Batch()
        self._book: Book | None = None
        self._complete_utc_ns = 0
        self._upload = Upload(self.directory, module.platform, config, self.health)
        # one thread for the disk: a batch after the other, while the event loop goes on
        self._disk = ThreadPoolExecutor(1, thread_name_prefix="log-disk")
        self._template = template.load(self._node.config.template, self._node.config.share_path / "templates")

    @property
    def directory(self) -> Path:
        """Where the segments are."""
        return paths.log(self._node.config.data_path)

    async def run(self) -> None:
        """Samples, writes and forwards until cancelled."""
        self._book = await self._open_book()
        stats = await self.module.writer(
            "log/stats", LogStats, rate_hz=1.0, link="request", description="How the logger does"
        )
        await self.module.serve(
            "sys/log/stats", LogStatsRequest, self._answer, reply=LogStats, description="How the logger does"
        )
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._sample(self._book, stats), name="log:sample")
                if self.config.mongodb_uri:
                    self._warn_of_open_password()
                    group.create_task(self._upload.run(), name="log:forward")
        finally:
            self._disk.submit(self._end, self._book)
            self._disk.shutdown(wait=True)
            for tap in self._taps.values():
                tap.close()

    async def stop(self) -> None:
        """The last values of a node are as good as any."""
        if self._book is not None:
            self._look(closely=True)
            await self._write(self._book)

    async def _open_book(self) -> Book:
        """Waits for a disk that takes the log; what is to be logged waits in shared memory."""
        self.health.report(DISK, description="The disk takes the log")
        loop = asyncio.get_running_loop()
        platform, boot_id, repairs = self.module.platform, self._node.clock.boot_id, Repairs()
        while True:
            try:
                book = await loop.run_in_executor(
                    self._disk, Book, self.directory, platform, self.config, boot_id, repairs
                )
            except OSError as error:
                self._say_disk(error)
                await asyncio.sleep(DISK_RETRY_S)
            else:
                break
        self.health.report(DISK)
        if repairs.bytes:
            log.warning("the last run did not end: %d bytes were half-written", repairs.bytes)
        self._tell_damage(repairs)
        return book

    def _say_disk(self, error: OSError) -> None:
        state = "full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "failing"
        detail = f"{self.directory}: {error.strerror or error}"
        self.health.report(DISK, state, level="warn", detail=detail)

    def _tell_damage(self, repairs: Repairs) -> None:
        now_ns, wall_ns = self.module.now_ns(), utc_ns()
        for hole in repairs.holes:
            gap = LogGap("damaged", hole.queue, "", hole.last - hole.first + 1, hole.first, hole.last)
            self._batch.gaps.append((gap, now_ns, wall_ns))
        for path in repairs.set_aside:
            log.warning("%s: nothing in it can be read, it was set aside", path)
            self._batch.gaps.append((LogGap("damaged", "", path.name, 0), now_ns, wall_ns))

    def _end(self, book: Book) -> None:
        try:
            if self._batch:
                book.write(self._batch)
            book.close()
        except OSError as error:
            log.error("%s: %d bytes of the log are lost: %s", self.directory, book.waiting, error.strerror)

    async def _sample(self, book: Book, stats: BoardWriter[LogStats]) -> None:
        every = max(1, round(self.config.flush_s / self.config.period_s))
        second = max(1, round(1.0 / self.config.period_s))
        count = 0
        async for _ in self.module.every(self.config.period_s):
            self._follow_table()
            self._look()
            count += 1
            if count % every == 0:
                await self._write(book)
            if count % second == 0:
                stats.write(await self._stats(book))

    def _follow_table(self) -> None:
        self._table.refresh()
        if self._table.version == self._table_version:
            return
        self._table_version = self._table.version
        for tap in self._taps.values():
            tap.look_again()
        assert self._book is not None
        opened, closed = self._plan.update(self._resources())
        for path in closed:
            tap = self._taps.pop(path)
            if tap.track.every:
                self._take_all(tap)  # what its writer left in its last period
            tap.close()
        now_ns = self.module.now_ns()
        for track in opened:
            # a stamp from the future is one of another boot, whose clock began elsewhere
            last_ns = self._book.last_stamps.get(track.path)
            after_ns = last_ns if last_ns is not None and last_ns <= now_ns else None
            self._taps[track.path] = LogTap(self._node.shm_dir, track, after_ns)

    def _resources(self) -> list[Resource]:
        """The template's resources and those that modules added; the template says how they are logged."""
        found = {resource.path: resource for resource in self._template.resources}
        for entry in self._table:
            for resource in entry.provides:
                found.setdefault(resource.path, resource)
        return [resource for path, resource in found.items() if path != GAPS]

    def _look(self, *, closely: bool = False) -> None:
        """Takes what is new. `closely`: also out of rings that have just appeared."""
        now_ns, wall_ns = self.module.now_ns(), utc_ns()
        for tap in self._taps.values():
            if closely:
                tap.look_again()
            if tap.still(now_ns):
                continue
            track = tap.track
            if track.every:
                self._take_all(tap)
            elif self._plan.due(track.path, now_ns) and (frame := tap.newest()) is not None:
                self._batch.frames.append((track, frame, wall_ns, ""))

    def _take_all(self, tap: LogTap) -> None:
        frames, lost = tap.all()
        wall_ns = utc_ns()
        self._batch.frames += [
            (tap.track, frame, wall_ns, self._sender(tap.track, frame)) for frame in frames
        ]
        if lost:
            assert self._book is not None
            gap = LogGap("ring", self._book.queue(tap.track), tap.track.path, lost)
            self._batch.gaps.append((gap, self.module.now_ns(), wall_ns))

    def _sender(self, track: Track, frame: Frame) -> str:
        if track.kind is not Kind.COMMAND:
            return ""
        proven = sender_of(frame.extension)
        if proven is not None:
            return str(proven)
        if frame.sender_hw != self._node.hardware:
            return f"{frame.sender_hw:08x}"
        entry = self._table.application(frame.sender_app)
        # a command of the operator may have ended before the logger looks
        return f"{entry.id if entry is not None else f'{frame.sender_app:08x}'}@{self._node.platform}"

    async def _write(self, book: Book) -> None:
        batch, self._batch = self._batch, Batch()
        taken_utc_ns = utc_ns()
        if not batch and not book.waiting:
            self._complete_utc_ns = taken_utc_ns
            return
        try:
            await asyncio.get_running_loop().run_in_executor(self._disk, book.write, batch)
        except OSError as error:
            self._say_disk(error)
            return
        self.health.report(DISK)
        self._complete_utc_ns = taken_utc_ns
        self._upload.on_written()

    def _warn_of_open_password(self) -> None:
        path = self._node.config_dir / "services" / "logger.toml"
        open_to_all = path.exists() and path.stat().st_mode & 0o007
        if password_in(self.config.mongodb_uri) and open_to_all:
            log.warning("%s: everybody can read the password in it; expected mode 0640, group swarm", path)
            self.health.report(
                PASSWORD, "readable", level="warn", detail=f"{path}: expected mode 0640, group swarm"
            )

    async def _answer(self, request: LogStatsRequest, _: Meta) -> LogStats:
        assert self._book is not None
        if request.flush:
            self._follow_table()
            self._look(closely=True)
            await self._write(self._book)
        return await self._stats(self._book)

    async def _stats(self, book: Book) -> LogStats:
        segments, ring_bytes = await asyncio.get_running_loop().run_in_executor(self._disk, book.size)
        return LogStats(
            book.totals.frames,
            book.totals.bytes,
            book.totals.missing + self._upload.gaps,
            len(self._taps),
            segments,
            ring_bytes,
            str(self.directory),
            self._upload.forwarded,
            self._upload.behind(book.counters),
            self._upload.state,
            self._complete_utc_ns,
        )
