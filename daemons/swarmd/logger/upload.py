"""Uploads the record to MongoDB: a batch at a time, in a thread that nothing waits for without a bound."""

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from swarmd.logger.config import Config
from swarmd.logger.forward import Forwarder
from swarmware.errors import ConfigError, Denied, SwarmError
from swarmware.health.monitor import HealthMonitor

if TYPE_CHECKING:
    from swarmware.record.mongo import MongoStore

T = TypeVar("T")

log = logging.getLogger("swarm.logger")

MONGODB: Final = "mongodb"
"""Name of the condition that `swarmctl health` shows."""
TIMEOUTS: Final = 2
"""A batch is given up, and tried again, after so many times the time of an answer."""


class Upload:
    """Forwards what the ring holds until cancelled; a server that hangs delays neither that nor the ring."""

    def __init__(self, directory: Path, platform: str, config: Config, health: HealthMonitor) -> None:
        self._directory = directory
        self._platform = platform
        self._config = config
        self._health = health
        self._written = asyncio.Event()
        self._store: MongoStore | None = None
        self._forwarder: Forwarder | None = None
        self.state = "off"
        """off | connected | away: reason."""

    @property
    def forwarded(self) -> int:
        """Entries stored since the start."""
        return self._forwarder.forwarded if self._forwarder else 0

    @property
    def gaps(self) -> int:
        """Entries that the ring overwrote before they were stored."""
        return self._forwarder.gaps if self._forwarder else 0

    def behind(self, counters: dict[str, int]) -> int:
        """Entries of the ring that are not stored yet."""
        if self._forwarder is None:
            return sum(counters.values()) if self.state.startswith("away") else 0
        return self._forwarder.behind(counters)

    def on_written(self) -> None:
        """There may be more to forward."""
        self._written.set()

    async def run(self) -> None:
        """Forwards until cancelled; returns when the address of the server is none."""
        self._health.report(MONGODB, description="Forwarding to MongoDB")
        try:
            while True:
                self._written.clear()
                try:
                    more = await self._step() > 0
                except ConfigError as error:
                    # the local log does not depend on it
                    log.error("%s: forwarding is off", error)
                    self.state = f"off: {error}"
                    self._health.report(MONGODB, "misconfigured", level="warn", detail=str(error))
                    return
                except (SwarmError, OSError) as error:
                    self._say("denied" if isinstance(error, Denied) else "unreachable", str(error))
                    await asyncio.sleep(self._config.retry_s)
                    continue
                if not more:
                    await self._written.wait()
        finally:
            if self._store is not None:
                _aside(self._store.close).cancel()  # it asks the server, which may hang: nobody waits

    async def _step(self) -> int:
        """Entries of the next batch, 0 when all is stored."""
        batch = _aside(self._forward)
        answer_s = self._config.answer_s
        try:
            late = not (await asyncio.wait([batch], timeout=answer_s))[0]
            if late:
                self._say("slow", f"no answer within {answer_s:g} s")
            stored = await batch
        finally:
            batch.cancel()
        if not late:
            self._health.report(MONGODB)
            self.state = "connected"
        return stored

    def _say(self, state: str, why: str) -> None:
        self.state = f"away: {why}"
        self._health.report(MONGODB, state, level="warn", detail=why)

    def _forward(self) -> int:
        """Runs in a thread: also the look-up of the server's name may take long."""
        if self._forwarder is None:
            from swarmware.record.mongo import MongoStore

            config = self._config
            self._store = MongoStore(
                config.mongodb_uri,
                config.mongodb_database,
                queue_size=config.queue_size,
                queue_bytes=config.queue_bytes,
                answer_s=TIMEOUTS * config.answer_s,
            )
            self._forwarder = Forwarder(self._directory, self._platform, self._store, config.forward_batch)
        return self._forwarder.step()


def _aside(function: Callable[[], T]) -> "asyncio.Future[T]":
    """What the function gives, from a thread that the process does not wait for when it ends.

    The threads of an executor are joined there: a server that hangs would hold the process up.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()

    def finish(result: T | None, error: BaseException | None) -> None:
        if future.cancelled():
            return
        if error is not None:
            future.set_exception(error)
        else:
            future.set_result(result)  # type: ignore[arg-type]  # without an error there is one

    def run() -> None:
        result, error = None, None
        try:
            result = function()
        except BaseException as raised:  # noqa: BLE001  # whoever awaits the future gets it
            error = raised
        with contextlib.suppress(RuntimeError):  # the loop has ended: nobody waits any more
            loop.call_soon_threadsafe(finish, result, error)

    threading.Thread(target=run, name="log-mongodb", daemon=True).start()
    return future
