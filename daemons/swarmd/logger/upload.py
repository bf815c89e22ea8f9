"""Upload of the log to MongoDB: one batch at a time, in a thread, with a time-out."""

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from swarmd.logger.config import Config
from swarmware.errors import ConfigError, Denied, NoAnswer, SwarmError
from swarmware.health.monitor import HealthMonitor

if TYPE_CHECKING:
    from swarmd.logger.log_forwarder import LogForwarder
    from swarmware.recorder.mongo import MongoStore

T = TypeVar("T")

log = logging.getLogger("swarm.logger")

MONGODB: Final = "mongodb"
"""Name of the health check that `swarmctl health` shows."""
TIMEOUTS: Final = 2
"""Number of time-outs (`answer_s`) after which a batch is abandoned and repeated."""


class UploadState(StrEnum):
    """Connection state of the upload to MongoDB."""

    OFF = "off"
    """The address is missing or invalid, or no connection was tried yet."""
    CONNECTED = "connected"
    AWAY = "away"
    """The server does not answer or stores nothing, so the ring keeps the entries."""


class Upload:
    """Forwards the ring until cancelled; a server that hangs delays neither the shutdown nor the ring."""

    def __init__(self, directory: Path, platform: str, config: Config, health: HealthMonitor) -> None:
        self._directory = directory
        self._platform = platform
        self._config = config
        self._health = health
        self._written = asyncio.Event()
        self._store: MongoStore | None = None
        self._forwarder: LogForwarder | None = None
        self._state = UploadState.OFF
        self._why = ""
        self._refused = 0
        """Number of values that the server has refused since the start of the service."""

    @property
    def state(self) -> str:
        """State for operators, with the reason, such as `away: no answer within 5 s`."""
        return f"{self._state}: {self._why}" if self._why else str(self._state)

    @property
    def forwarded(self) -> int:
        """Entries stored since the start of the service."""
        return self._forwarder.forwarded if self._forwarder else 0

    @property
    def gaps(self) -> int:
        """Entries that the ring overwrote before they were forwarded."""
        return self._forwarder.gaps if self._forwarder else 0

    def backlog(self, counters: dict[str, int]) -> int:
        """Number of entries in the ring that are not stored yet."""
        if self._forwarder is None:
            return sum(counters.values()) if self._state is UploadState.AWAY else 0
        return self._forwarder.backlog(counters)

    def on_written(self) -> None:
        """Wakes the upload, because the ring has new entries."""
        self._written.set()

    async def run(self) -> None:
        """Forwards until cancelled; returns when the address of the server is invalid."""
        self._health.report(MONGODB, description="Forwarding to MongoDB")
        try:
            while True:
                # before the step: entries written during it must wake the next one
                self._written.clear()
                try:
                    more = await self._step() > 0
                except ConfigError as error:
                    # local logging continues without the upload
                    log.error("%s: forwarding is off", error)
                    self._state, self._why = UploadState.OFF, str(error)
                    self._health.report(MONGODB, "misconfigured", level="warn", detail=str(error))
                    return
                except (SwarmError, OSError) as error:
                    self._report_fault(_state_of(error), str(error))
                    await asyncio.sleep(self._config.retry_s)
                    continue
                if not more:
                    await self._written.wait()
        finally:
            if self._store is not None:
                _in_thread(
                    self._store.close
                ).cancel()  # not awaited, because closing contacts the server, which may hang

    async def _step(self) -> int:
        """Forwards the next batch; returns its number of entries, or 0 if all entries are stored."""
        batch = _in_thread(self._forward)
        answer_s = self._config.answer_s
        try:
            late = not (await asyncio.wait([batch], timeout=answer_s))[0]
            if late:
                self._report_fault("slow", f"no answer within {answer_s:g} s")
            # the store gives up after a second time-out and raises; until then the batch may still succeed
            stored = await batch
        finally:
            batch.cancel()
        self._report_refusals()
        if not late:
            self._health.report(MONGODB)
            self._state, self._why = UploadState.CONNECTED, ""
        return stored

    def _report_refusals(self) -> None:
        """Logs entries that were stored without their values, once per decade of their number."""
        refused = self._store.refused if self._store is not None else []
        before, self._refused = self._refused, self._refused + len(refused)
        if refused and (not before or len(str(before)) < len(str(self._refused))):
            last = refused[-1]
            log.warning(
                "MongoDB refused %d values since the start, the last one of %s (%s): %s; stored as payload",
                self._refused,
                last.entry.topic,
                last.entry.type,
                last.reason,
            )

    def _report_fault(self, state: str, why: str) -> None:
        self._state, self._why = UploadState.AWAY, why
        self._health.report(MONGODB, state, level="warn", detail=why)

    def _forward(self) -> int:
        """Forwards the next batch; runs in a thread, because even resolving the server's name may block."""
        if self._forwarder is None:
            from swarmd.logger.log_forwarder import LogForwarder
            from swarmware.recorder.mongo import MongoStore

            config = self._config
            self._store = MongoStore(
                config.mongodb_uri,
                config.mongodb_database,
                queue_size=config.queue_size,
                queue_bytes=config.queue_bytes,
                answer_s=TIMEOUTS * config.answer_s,
            )
            self._forwarder = LogForwarder(self._directory, self._platform, self._store, config.forward_batch)
        return self._forwarder.step()


def _state_of(error: SwarmError | OSError) -> str:
    """State of the health check for an error of the store."""
    match error:
        case Denied():
            return "denied"
        case NoAnswer() | OSError():
            return "unreachable"
    return "refused"


def _in_thread(function: Callable[[], T]) -> "asyncio.Future[T]":
    """Runs the function in a daemon thread, which does not delay the end of the process.

    A thread of an executor would be joined at exit, which a server that hangs would block.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()

    def finish(result: T | None, error: BaseException | None) -> None:
        if future.cancelled():
            return
        if error is not None:
            future.set_exception(error)
        else:
            future.set_result(result)  # type: ignore[arg-type]  # a result without an error is of type T

    def run() -> None:
        result, error = None, None
        try:
            result = function()
        except BaseException as raised:  # noqa: BLE001  # raised again where the future is awaited
            error = raised
        with contextlib.suppress(RuntimeError):  # the event loop is closed, and the result not needed
            loop.call_soon_threadsafe(finish, result, error)

    threading.Thread(target=run, name="log-mongodb", daemon=True).start()
    return future
