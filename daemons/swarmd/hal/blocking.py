"""Sensors whose device blocks its reader: each is measured in a thread of its own (S2.4)."""

import asyncio
import queue
import threading
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, TypeVar

from swarmd.hal.driver import Sensor
from swarmware.errors import SwarmError

T = TypeVar("T")
R = TypeVar("R")


class DeviceThread:
    """A thread that calls functions of one device, one after the other.

    A device that hangs delays neither the event loop nor the end of the process, which does not wait for it.
    """

    def __init__(self, name: str) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._work, name=f"hal-{name}", daemon=True).start()

    def _work(self) -> None:
        while (call := self._calls.get()) is not None:
            call()

    async def run(self, function: Callable[[], R]) -> R:
        """Call a function in the thread; returns its result, or raises its error."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[R] = loop.create_future()

        def settle(result: R | None, error: Exception | None) -> None:
            if future.done():
                return  # the driver was closed meanwhile
            if error is not None:
                future.set_exception(error)
            else:
                future.set_result(result)  # type: ignore[arg-type]  # without an error there is a result

        def call() -> None:
            result: R | None = None
            failure: Exception | None = RuntimeError(f"{function}: failed in its thread, see the log")
            try:
                result = function()
                failure = None
            except (SwarmError, OSError) as error:
                failure = error
            finally:
                with suppress(RuntimeError):  # the loop has ended before the device answered
                    loop.call_soon_threadsafe(settle, result, failure)

        self._calls.put(call)
        return await future

    def close(self) -> None:
        """End the thread after its present call."""
        self._calls.put(None)


class BlockingSensor(Sensor, Generic[T]):
    """Base of the drivers of devices that block: `measure` runs in a thread, `publish` in the event loop.

    A driver that overrides `close` calls this one too.
    """

    _thread: DeviceThread | None = None

    @abstractmethod
    def measure(self) -> T:
        """Reads the device, in its own thread. Raises: DeviceError, OSError."""

    @abstractmethod
    def publish(self, value: T, now_ns: int) -> bool:
        """Publishes what was measured; `now_ns`: instant at which the measurement began."""

    async def read(self, now_ns: int) -> bool:
        """Measures once, without delaying other drivers."""
        if self._thread is None:
            self._thread = DeviceThread(self.name)
        return self.publish(await self._thread.run(self.measure), now_ns)

    async def close(self) -> None:
        """Ends the thread; it does not wait for a device that hangs."""
        if self._thread is not None:
            self._thread.close()
            self._thread = None
