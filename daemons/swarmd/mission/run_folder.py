"""The folder of each run: the mission as it ran, its progress and outcome, and its part of the log.

All files are read and written in one thread, so a slow disk delays no mission. A write that fails is
counted, and the first one is a warning.
"""

import asyncio
import logging
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import NotFound
from swarmware.mission.finding import Finding
from swarmware.mission.run_archive import (
    DOCUMENT,
    PROGRESS,
    RECORD,
    StoredRun,
    document_of,
    progress_of,
    run_folders,
    stored_runs,
)
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.core import HardwareClock
from swarmware.runtime.filewriter import naming, replace_file
from swarmware.types.mission import INACTIVE, MissionOrder, MissionProgress
from swarmware.types.mission_run import (
    LogCut,
    MissionHistory,
    RunDetails,
    RunRecord,
    RunRequest,
    RunSummary,
)
from swarmware.types.rpc import Empty

ENDS: Final = {f"state:{phase}": str(phase) for phase in INACTIVE}
"""Steps of a mission that end its run, with the outcome."""
PROGRESS_MAX_BYTES: Final = 4 << 20
"""Maximum size of the progress of one run, about 25 000 steps, so that a mission that loops for days does
not fill the disk."""
SHOWN_STEPS: Final = 1000
"""Maximum number of steps in an answer, some 150 kB."""
DELAY_S: Final = 0.5
"""Delay of the first write of a run: when an order arrives, all members wait for its receipt."""

log = logging.getLogger("swarm.mission")


class OpenRun(msgspec.Struct):
    """A run that has not ended."""

    record: RunRecord
    text: str
    folder: Path | None = None
    """None until the folder could be made."""
    bytes: int = 0
    """Size of the progress."""
    steps: int = 0
    left_out: int = 0


class RunDisk:
    """Writes and reads the folders; each call may wait for the disk."""

    def __init__(self, platform: str, data_path: Path, kept_runs: int) -> None:
        self._platform = platform
        self._missions = paths.missions(data_path)
        self._log = paths.log(data_path)
        self._kept_runs = kept_runs
        self._open: dict[int, OpenRun] = {}
        self._closed: set[int] = {0}
        """Runs that have ended, or have no folder, and epoch 0, which means no run."""
        self.failed_writes = 0
        self.failure = ""

    def begin(
        self, order: MissionOrder, by: str, findings: Iterable[Finding], at_ns: int, clock_to_utc_ns: int
    ) -> None:
        """Makes the folder of a run, and removes the oldest folders above the limit."""
        segments = tuple(self._segments()[-1:])
        cut = LogCut(self._platform, at_ns, at_ns + clock_to_utc_ns, segments=segments)
        record = RunRecord(
            epoch=order.epoch,
            mission=order.mission,
            role=order.role,
            hash=order.hash,
            file=order.file,
            text_hash=order.text_hash,
            params=order.params,
            priority=order.priority,
            members=order.members,
            issuer=order.issuer,
            ordered_by=by,
            findings=tuple(map(str, findings)),
            log=cut,
        )
        run = OpenRun(record, order.text)
        self._open[order.epoch] = run
        self._closed.discard(order.epoch)
        self._try(lambda: self._folder(run))
        self._try(self._remove_oldest)

    def add(self, steps: Iterable[MissionProgress], clock_to_utc_ns: int) -> None:
        """Appends steps to the runs to which they belong; the last step of a run ends it."""
        for step in steps:
            run = self._open.get(step.epoch) or self._found(step.epoch)
            if run is None:
                continue
            self._try(partial(self._append, run, step))
            if not step.block and step.event in ENDS:
                self._try(partial(self._end, run, step, clock_to_utc_ns))
                self._open.pop(step.epoch, None)
                self._closed.add(step.epoch)

    def history(self) -> MissionHistory:
        """All runs, newest first."""
        runs = tuple(self._summary(one) for one in reversed(stored_runs(self._missions)))
        return MissionHistory(self._platform, runs, self.failed_writes, self.failure)

    def details(self, epoch: int) -> RunDetails:
        """One run. Raises: NotFound."""
        one = self._stored(epoch)
        if one is None:
            raise NotFound(f"{self._platform}: no run {epoch}; `swarmctl mission history` lists the runs")
        progress = progress_of(one.folder, SHOWN_STEPS)
        return RunDetails(self._platform, self._summary(one), one.record, document_of(one.folder), progress)

    def _summary(self, one: StoredRun) -> RunSummary:
        record = one.record
        return RunSummary(
            record.epoch,
            record.mission,
            record.role,
            record.outcome or ("open" if record.epoch in self._open else "interrupted"),
            record.reason,
            record.ordered_by,
            record.log.first_utc_ns,
            record.log.last_utc_ns,
            one.folder.name,
        )

    def _stored(self, epoch: int) -> StoredRun | None:
        return next((one for one in stored_runs(self._missions) if one.record.epoch == epoch), None)

    def _found(self, epoch: int) -> OpenRun | None:
        """The run that an earlier process of the daemon began, and that continues."""
        if epoch in self._closed:
            return None
        one = self._stored(epoch)
        if one is None or one.record.outcome:
            self._closed.add(epoch)
            return None
        try:
            written = (one.folder / PROGRESS).read_bytes()
        except OSError:
            written = b""  # no step was appended, or the disk fails, which the next step reports
        run = OpenRun(one.record, "", one.folder, len(written), written.count(b"\n"))
        self._open[epoch] = run
        return run

    def _folder(self, run: OpenRun) -> Path:
        """The folder of a run, which is made at the first write that succeeds. Raises: OSError."""
        if run.folder is None:
            began = datetime.fromtimestamp(run.record.log.first_utc_ns // 10**9, UTC)
            plain = re.sub(r"[^\w.-]", "_", run.record.mission, flags=re.ASCII)[:64] or "mission"
            name = f"{began:%Y%m%dT%H%M%SZ}-{plain}"
            folder, number = self._missions / name, 1
            while folder.exists():
                number += 1
                folder = self._missions / f"{name}-{number}"
            folder.mkdir(parents=True)
            run.folder = folder
            replace_file(folder / DOCUMENT, run.text.encode())
            self._save(folder, run.record)
        return run.folder

    def _append(self, run: OpenRun, step: MissionProgress) -> None:
        line = msgspec.json.encode(step) + b"\n"
        if run.bytes + len(line) > PROGRESS_MAX_BYTES:
            run.left_out += 1
            return
        file = self._folder(run) / PROGRESS
        with naming(file), file.open("ab") as progress:
            progress.write(line)
        run.bytes += len(line)
        run.steps += 1

    def _end(self, run: OpenRun, step: MissionProgress, clock_to_utc_ns: int) -> None:
        first = run.record.log.segments
        segments = tuple(name for name in self._segments() if not first or name >= first[0])
        replace = msgspec.structs.replace
        last_utc_ns = step.at_ns + clock_to_utc_ns
        cut = replace(run.record.log, last_ns=step.at_ns, last_utc_ns=last_utc_ns, segments=segments)
        run.record = replace(
            run.record,
            outcome=ENDS[step.event],
            reason=step.text,
            steps=run.steps,
            left_out=run.left_out,
            log=cut,
        )
        self._save(self._folder(run), run.record)

    @staticmethod
    def _save(folder: Path, record: RunRecord) -> None:
        replace_file(folder / RECORD, msgspec.json.format(msgspec.json.encode(record)) + b"\n")

    def _segments(self) -> list[str]:
        return sorted(path.name for path in self._log.glob("*.mcap") if path.stem.isdigit())

    def _remove_oldest(self) -> None:
        kept = {run.folder for run in self._open.values()}
        folders = run_folders(self._missions)
        surplus = len(folders) - self._kept_runs
        for folder in [one for one in folders if one not in kept][: max(surplus, 0)]:
            # deepest first; `shutil` would add modules of compression to each node's memory
            for path in sorted(folder.rglob("*"), reverse=True):
                if path.is_dir() and not path.is_symlink():
                    path.rmdir()
                else:
                    path.unlink()
            folder.rmdir()
            log.info("folder of run %s: removed; the newest %d are kept", folder.name, self._kept_runs)

    def _try(self, write: Callable[[], object]) -> None:
        try:
            write()
        except OSError as error:
            self.failed_writes += 1
            self.failure = str(error)
            if self.failed_writes == 1:
                log.warning("folder of a run: %s; missions continue, further failures are counted", error)


class RunFolders:
    """Passes accepted orders and steps on to the thread that writes them, and answers requests for runs."""

    def __init__(self, disk: RunDisk, clock: HardwareClock) -> None:
        self._disk = disk
        self._clock = clock
        self._thread = ThreadPoolExecutor(1, "mission-runs")
        self._orders: list[Callable[[int], None]] = []
        self._timer: asyncio.TimerHandle | None = None

    def serve(self, module: Module) -> None:
        """Serve the requests for runs."""
        module.serve(
            "sys/mission/history",
            Empty,
            self._on_history,
            reply=MissionHistory,
            description="Runs that this platform has played",
        )
        module.serve(
            "sys/mission/run",
            RunRequest,
            self._on_run,
            reply=RunDetails,
            description="One run: mission, parameters, progress, outcome, its part of the log",
        )

    def begin(self, order: MissionOrder, by: str, findings: tuple[Finding, ...]) -> None:
        """Records an accepted order; it is written within `DELAY_S`, and before the first step."""
        self._orders.append(partial(self._disk.begin, order, by, findings, self._clock.now_ns()))
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(DELAY_S, self._write_orders)

    def add(self, steps: list[MissionProgress]) -> None:
        """Records steps of all runs, in their order."""
        self._write_orders()
        self._thread.submit(self._disk.add, steps, self._clock_to_utc_ns())

    def close(self) -> None:
        """Writes what is left, and ends the thread."""
        self._write_orders()
        self._thread.shutdown()

    def _write_orders(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        orders, self._orders = self._orders, []
        for begin in orders:
            self._thread.submit(begin, self._clock_to_utc_ns())

    def _clock_to_utc_ns(self) -> int:
        return utc_ns() - self._clock.now_ns()

    async def _on_history(self, request: Empty, meta: Meta) -> MissionHistory:
        self._write_orders()
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._disk.history)

    async def _on_run(self, request: RunRequest, meta: Meta) -> RunDetails:
        self._write_orders()
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, self._disk.details, request.epoch)
