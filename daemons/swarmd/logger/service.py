"""The logger's shell: samples shared memory, writes batches to disk, and forwards them to MongoDB."""

import asyncio
import errno
import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from swarmd.logger import config as settings
from swarmd.logger.core.sampling_plan import LoggedResource, SamplingPlan
from swarmd.logger.core.type_descriptions import Definitions, TypeDescriptions
from swarmd.logger.recorder import GAPS, Batch, Recorder
from swarmd.logger.taps import LogTap
from swarmd.logger.upload import Upload
from swarmware.model import paths, template
from swarmware.model.clock import utc_ns
from swarmware.model.frame import Frame
from swarmware.model.resource import Kind, Resource
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.recorder.address import password_in
from swarmware.recorder.ring import Repairs
from swarmware.service.service import Service
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.delivery.sender import sender_of
from swarmware.types.log import GapCause, LogGap, LogStats, LogStatsRequest

log = logging.getLogger("swarm.logger")

DISK: Final = "disk"
PASSWORD: Final = "mongodb_password"
"""Names of the health checks that `swarmctl health` shows."""
DISK_RETRY_S: Final = 1.0


class Logger(Service):
    """Records the resources of the node in the local ring, and forwards the ring to MongoDB."""

    name = "logger"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        self._node = module.node
        self._table = self._node.table
        self._table_version = -1
        self._plan = SamplingPlan()
        self._types = TypeDescriptions()
        self._taps: dict[str, LogTap] = {}
        self._batch = Batch()
        self._recorder: Recorder | None = None
        self._size: tuple[int, int] | None = None
        """Number of segments and bytes of the ring after the last write, or None before the first request."""
        self._complete_utc_ns = 0
        self._upload = Upload(self.directory, module.platform, config, self.health)
        # a single thread writes the batches in order, without blocking the event loop
        self._disk = ThreadPoolExecutor(1, thread_name_prefix="log-disk")
        self._template = template.load(self._node.config.template, self._node.config.share_path / "templates")

    @property
    def directory(self) -> Path:
        """Folder of the log segments."""
        return paths.log(self._node.config.data_path)

    async def run(self) -> None:
        """Samples, records and forwards until cancelled."""
        self._recorder = await self._open_recorder()
        stats = self.module.writer(
            "log/stats", LogStats, rate_hz=1.0, link="request", description="Logger statistics"
        )
        self.module.serve(
            "sys/log/stats",
            LogStatsRequest,
            self._answer,
            reply=LogStats,
            description="Logger statistics",
        )
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._sample(self._recorder, stats), name="log:sample")
                if self.config.mongodb_uri:
                    self._warn_of_readable_password()
                    group.create_task(self._upload.run(), name="log:forward")
        finally:
            self._batch.descriptions = self._types.found
            # in the thread of the disk, behind the batches that wait there
            self._disk.submit(self._close, self._recorder)
            self._disk.shutdown(wait=True)
            for tap in self._taps.values():
                tap.close()

    async def stop(self) -> None:
        """Records the values that were published up to the stop."""
        if self._recorder is not None:
            self._sample_all(new_rings=True)
            await self._write(self._recorder)

    async def _open_recorder(self) -> Recorder:
        """Opens the ring, and retries while the disk fails; values stay in shared memory until then."""
        self.health.report(DISK, description="Writing the log to disk")
        loop = asyncio.get_running_loop()
        platform, boot_id, repairs = self.module.platform, self._node.clock.boot_id, Repairs()
        while True:
            try:
                recorder = await loop.run_in_executor(
                    self._disk, Recorder, self.directory, platform, self.config, boot_id, repairs
                )
            except OSError as error:
                self._report_disk_fault(error)
                await asyncio.sleep(DISK_RETRY_S)
            else:
                break
        self.health.report(DISK)
        if repairs.bytes:
            log.warning(
                "the last run did not end its log: %d bytes of incomplete records removed", repairs.bytes
            )
        self._record_damage(repairs)
        return recorder

    def _report_disk_fault(self, error: OSError) -> None:
        state = "full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "failing"
        detail = f"{self.directory}: {error.strerror or error}"
        self.health.report(DISK, state, level="warn", detail=detail)

    def _record_damage(self, repairs: Repairs) -> None:
        now_ns, wall_ns = self.module.now_ns(), utc_ns()
        self._batch.utc_minus_clock_ns = wall_ns - now_ns
        for hole in repairs.holes:
            gap = LogGap(GapCause.DAMAGED, hole.queue, "", hole.last - hole.first + 1, hole.first, hole.last)
            self._batch.gaps.append((gap, now_ns, wall_ns))
        for path in repairs.set_aside:
            log.warning("%s: no readable record; the segment was set aside", path)
            self._batch.gaps.append((LogGap(GapCause.DAMAGED, "", path.name, 0), now_ns, wall_ns))

    def _close(self, recorder: Recorder) -> None:
        try:
            if self._batch:
                recorder.write(self._batch)
            recorder.close()
        except OSError as error:
            log.error(
                "%s: %d bytes of the log are lost: %s", self.directory, recorder.pending_bytes, error.strerror
            )

    async def _sample(self, recorder: Recorder, stats: BoardWriter[LogStats]) -> None:
        every = max(1, round(self.config.flush_s / self.config.period_s))
        second = max(1, round(1.0 / self.config.period_s))
        count = 0
        async for _ in self.module.every(self.config.period_s):
            self._follow_table()
            self._sample_all()
            count += 1
            if count % every == 0:
                await self._write(recorder)
            if count % second == 0:
                stats.write(await self._stats(recorder))

    def _follow_table(self) -> None:
        self._table.refresh()
        if self._table.version == self._table_version:
            return
        self._table_version = self._table.version
        for refused in self._types.update(map(_definitions, self._table)):
            log.warning("type %s: description invalid or too long; recorded without names of fields", refused)
        for tap in self._taps.values():
            tap.search_again()
        assert self._recorder is not None
        opened, closed = self._plan.update(self._resources())
        for path in closed:
            tap = self._taps.pop(path)
            if tap.resource.every_value:
                self._read_all(tap)  # values since the last sample
            tap.close()
        now_ns = self.module.now_ns()
        for resource in opened:
            # a stamp in the future comes from an earlier boot, whose clock had another origin
            last_ns = self._recorder.last_stamps.get(resource.path)
            after_ns = last_ns if last_ns is not None and last_ns <= now_ns else None
            self._taps[resource.path] = LogTap(self._node.shm_dir, resource, after_ns)

    def _resources(self) -> list[Resource]:
        """Resources of the template and of the applications; the template's `log` takes precedence."""
        found = {resource.path: resource for resource in self._template.resources}
        for entry in self._table:
            for resource in entry.provides:
                found.setdefault(resource.path, resource)
        # gaps are written by the recorder itself, with their own place in the queue
        return [resource for path, resource in found.items() if path != GAPS]

    def _sample_all(self, *, new_rings: bool = False) -> None:
        """Reads all new values; `new_rings` also searches for rings that did not exist at the last sample."""
        now_ns, wall_ns = self.module.now_ns(), utc_ns()
        self._batch.utc_minus_clock_ns = wall_ns - now_ns
        plan = self._plan
        for path, tap in self._taps.items():
            if new_rings:
                tap.search_again()
            if tap.is_idle(now_ns) or plan.waits(path, now_ns):  # true for most taps
                continue
            resource = tap.resource
            if resource.every_value:
                self._read_all(tap)
            elif plan.due(path, now_ns) and (frame := tap.newest()) is not None:
                self._batch.frames.append((resource, frame, wall_ns, ""))

    def _read_all(self, tap: LogTap) -> None:
        frames, lost = tap.all()
        wall_ns = utc_ns()
        self._batch.frames += [
            (tap.resource, frame, wall_ns, self._sender(tap.resource, frame)) for frame in frames
        ]
        if lost:
            assert self._recorder is not None
            gap = LogGap(GapCause.RING, self._recorder.queue(tap.resource), tap.resource.path, lost)
            self._batch.gaps.append((gap, self.module.now_ns(), wall_ns))

    def _sender(self, resource: LoggedResource, frame: Frame) -> str:
        if resource.kind is not Kind.COMMAND:
            return ""
        proven = sender_of(frame.extension)
        if proven is not None:
            return str(proven)
        if frame.sender_hw != self._node.hardware:
            return f"{frame.sender_hw:08x}"
        entry = self._table.application(frame.sender_app)
        # the sender, such as an operator's command, may have ended before this sample
        return f"{entry.id if entry is not None else f'{frame.sender_app:08x}'}@{self._node.platform}"

    async def _write(self, recorder: Recorder) -> None:
        batch, self._batch = self._batch, Batch()
        batch.descriptions = self._types.found
        taken_utc_ns = utc_ns()
        # bytes of a failed write are retried even without new values
        if not batch and not recorder.pending_bytes:
            self._complete_utc_ns = taken_utc_ns
            return
        try:
            loop = asyncio.get_running_loop()
            self._size = await loop.run_in_executor(self._disk, _record, recorder, batch)
        except OSError as error:
            self._report_disk_fault(error)
            return
        self.health.report(DISK)
        self._complete_utc_ns = taken_utc_ns
        self._upload.on_written()

    def _warn_of_readable_password(self) -> None:
        path = self._node.config_dir / "services" / "logger.toml"
        open_to_all = path.exists() and path.stat().st_mode & 0o007
        if password_in(self.config.mongodb_uri) and open_to_all:
            log.warning("%s: its password is readable by all users; expected mode 0640, group swarm", path)
            self.health.report(
                PASSWORD, "readable", level="warn", detail=f"{path}: expected mode 0640, group swarm"
            )

    async def _answer(self, request: LogStatsRequest, _: Meta) -> LogStats:
        assert self._recorder is not None
        if request.flush:
            self._follow_table()
            self._sample_all(new_rings=True)
            await self._write(self._recorder)
        return await self._stats(self._recorder)

    async def _stats(self, recorder: Recorder) -> LogStats:
        if self._size is None:
            loop = asyncio.get_running_loop()
            self._size = await loop.run_in_executor(self._disk, recorder.size)
        segments, ring_bytes = self._size
        return LogStats(
            recorder.totals.frames,
            recorder.totals.bytes,
            recorder.totals.missing + self._upload.gaps,
            len(self._taps),
            segments,
            ring_bytes,
            str(self.directory),
            self._upload.forwarded,
            self._upload.backlog(recorder.counters),
            self._upload.state,
            self._complete_utc_ns,
        )


def _definitions(entry: AppEntry) -> Definitions:
    return Definitions(entry.id, entry.provides, entry.types)


def _record(recorder: Recorder, batch: Batch) -> tuple[int, int]:
    recorder.write(batch)
    return recorder.size()
