"""Replay of a log, whose recorded resources replace the devices of a vehicle."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec

from swarmd.hal.blocking import BlockingDevice
from swarmd.hal.config import Config, RecordingDriver
from swarmd.hal.driver import Device, DeviceError, DeviceGone, Sensor, Site
from swarmware.errors import InvalidInput, NotFound, WireError
from swarmware.model.resource import Kind
from swarmware.module.module import Module
from swarmware.module.streamwriter import StreamWriter
from swarmware.module.writer import BoardWriter
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import FolderSource, LogSource, Query
from swarmware.recorder.spool import SpoolSource

_CATCH_UP_NS: Final = 1_000_000_000
"""Maximum stall that is caught up; after a longer stall the recording continues where it was."""


class Playback:
    """Converts instants of a recording to the clock of this computer.

    `speed`: seconds of the recording that are played in one second. The recording has its own clock.
    """

    def __init__(self, first_ns: int, start_ns: int, speed: float) -> None:
        self._first_ns = first_ns
        self._start_ns = start_ns
        self._speed = speed
        self.stalled_ns = 0
        """Sum of the stalls that were not caught up."""

    def local_ns(self, recorded_ns: int) -> int:
        """Converts an instant of the recording to the clock of this computer."""
        return self._start_ns + round((recorded_ns - self._first_ns) / self._speed)

    def is_due(self, recorded_ns: int, now_ns: int) -> bool:
        """True if an entry is to be published now; a long stall shifts all later entries."""
        late_ns = now_ns - self.local_ns(recorded_ns)
        if late_ns > _CATCH_UP_NS:
            # the recording is shifted, and nothing is skipped
            self._start_ns += late_ns
            self.stalled_ns += late_ns
        return late_ns >= 0


_BATCH: Final = 1000
"""Maximum number of entries that are published before other drivers have their turn."""
_STREAMS: Final = frozenset({Kind.STREAM.value, Kind.EVENT.value})

Writer = BoardWriter[Any] | StreamWriter[Any]


class RecordedDevices(BlockingDevice, Sensor):
    """Publishes the entries of a log at the recorded pace, each with its own stamp."""

    name = "recording"

    def __init__(self, config: RecordingDriver) -> None:
        self.period_s = 1 / config.wake_hz
        self._config = config
        self._source = config.file or config.folder
        """Path of the file or folder, for error messages."""
        self._file: BinaryIO | None = None
        self._entries: Iterator[LogEntry] = iter(())
        self._next: LogEntry | None = None
        self._playback: Playback | None = None
        self._platform = ""
        self._module: Module | None = None
        self._writers: dict[str, Writer] = {}
        self.refused = 0
        """Number of entries of unknown types, or with a payload that does not match the type."""

    async def open(self, module: Module) -> None:
        """Opens the log; its resources appear with their first entries."""
        self._module, self._playback = module, None
        await super().open(module)

    def connect(self) -> None:
        """Finds the first entry. Raises: DeviceGone without the folder, DeviceError without entries."""
        self._platform = self._config.platform
        self._rewind()
        first = self._next
        if first is None:
            raise DeviceError(f"log {self._source}: no entries of {self._config.pattern}")
        self._platform = first.platform

    def _rewind(self) -> None:
        pattern = f"/{self._platform or '*'}/{self._config.pattern}"
        try:
            self._entries = self._opened_source().entries(Query(pattern=pattern))
        except InvalidInput as error:  # a log of another program
            raise DeviceError(str(error)) from error
        self._advance()

    def _opened_source(self) -> LogSource:
        """Opens the log at its begin. Raises: DeviceGone when it is missing."""
        config = self._config
        try:
            if not config.file:
                return FolderSource([Path(config.folder)])
            self._close_file()
            self._file = Path(config.file).open("rb")  # noqa: SIM115 - read until `disconnect`
            return SpoolSource(self._file, config.file)
        except NotFound as error:
            raise DeviceGone(str(error)) from error
        except OSError as error:
            raise DeviceGone(f"log {config.file}: {error.strerror}") from error

    def _advance(self) -> None:
        """Reads the next entry. Raises: DeviceError for a file of another format."""
        try:
            self._next = next(self._entries, None)
        except WireError as error:
            raise DeviceError(str(error)) from error

    def _close_file(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    async def read(self, now_ns: int) -> bool:
        """Publishes the entries that are due."""
        due = await self.in_thread(lambda: self._due(now_ns))
        playback = self._playback
        if playback is None:
            return False
        for entry in due:
            self._publish(entry, min(playback.local_ns(_sent_ns(entry)), now_ns))
        return bool(due)

    def _due(self, now_ns: int) -> list[LogEntry]:
        """Due entries, read in the thread of the device."""
        found: list[LogEntry] = []
        while len(found) < _BATCH:
            entry = self._next
            if entry is None:
                if not self._config.loop or found:
                    return found  # the found entries have the time base of this pass
                self._rewind()
                self._playback = None
                if self._next is None:
                    raise DeviceError(f"log {self._source}: its entries were removed")
                continue
            if self._playback is None:
                # the first entry of a pass is due at once
                self._playback = Playback(entry.utc_ns, now_ns, self._config.speed)
            if not self._playback.is_due(entry.utc_ns, now_ns):
                return found
            found.append(entry)
            self._advance()
        return found

    def _publish(self, entry: LogEntry, stamp_ns: int) -> None:
        value = entry.value()
        if value is None:
            self.refused += 1
            return
        writer = self._writers.get(entry.path)
        if writer is None:
            writer = self._writers[entry.path] = self._open_writer(entry, type(value))
        writer.write(value, stamp_ns)

    def _open_writer(self, entry: LogEntry, cls: type[msgspec.Struct]) -> Writer:
        """Opens the writer of a resource. Raises: Conflict when another program writes it."""
        if self._module is None:
            raise DeviceError(f"{self.name}: not open")
        if entry.kind in _STREAMS:
            kind: Any = entry.kind
            return self.managed(self._module, self._module.stream_writer(entry.path, cls, kind=kind))
        return self.managed(self._module, self._module.writer(entry.path, cls))

    def disconnect(self) -> None:
        """Releases the entries of the log."""
        self._entries, self._next = iter(()), None
        self._close_file()

    async def close(self) -> None:
        """Closes the log and all resources."""
        await super().close()
        self._writers = {}


def _sent_ns(entry: LogEntry) -> int:
    """Instant of a value in UTC, or of its recording if the instant is not known."""
    return entry.sent_utc_ns or entry.utc_ns


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the log."""
    return [RecordedDevices(config.recording)]
