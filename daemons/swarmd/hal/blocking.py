"""Drivers of devices that block their caller, each in a thread (S2.4)."""

import asyncio
import queue
import threading
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, TypeVar

from swarmd.hal.driver import Device, DeviceError, Sensor
from swarmware.errors import SwarmError
from swarmware.module.module import Module

T = TypeVar("T")
R = TypeVar("R")


class DeviceThread:
    """A thread that calls functions of one device, one after the other.

    A device that hangs delays neither the event loop nor the end of the process. The calls begin when the
    calls of `former`, the previous thread of this device, have ended, so that a reopened device has only one
    caller at a time.
    """

    def __init__(self, name: str, former: "DeviceThread | None" = None) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, args=(former,), name=f"hal-{name}", daemon=True)
        self._thread.start()

    def _work(self, former: "DeviceThread | None") -> None:
        if former is not None:
            former._thread.join()
        # None is the order of `close` to end the thread
        while (call := self._calls.get()) is not None:
            # `run` passes its errors on; errors of posted calls and of the last call have no receiver
            with suppress(SwarmError, OSError):
                call()

    def post(self, function: Callable[[], None]) -> None:
        """Calls a function in the thread without waiting for it; its errors are dropped."""
        self._calls.put(function)

    async def run(self, function: Callable[[], R]) -> R:
        """Calls a function in the thread; returns its result, or raises its error."""
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
            # replaced below; stays if the function raises an error that is not expected of a device
            failure: Exception | None = RuntimeError(f"{function}: failed in its thread, see the log")
            try:
                result = function()
                failure = None
            except (SwarmError, OSError) as error:
                failure = error
            finally:
                with suppress(RuntimeError):  # the event loop ended before the device answered
                    loop.call_soon_threadsafe(settle, result, failure)

        self._calls.put(call)
        return await future

    def close(self, last: Callable[[], None]) -> None:
        """Ends the thread after the calls before, and the call `last`."""
        self._calls.put(last)
        self._calls.put(None)


class BlockingDevice(Device):
    """Base of drivers whose calls of the device are made in a separate thread, from `connect` to
    `disconnect`.

    A driver that overrides `open` or `close` must call the overridden method, too.
    """

    _thread: DeviceThread | None = None
    _former: DeviceThread | None = None

    def connect(self) -> None:  # some devices need no opening
        """Opens the device, in its thread. Raises: DeviceError, OSError."""

    def disconnect(self) -> None:  # some devices need no closing
        """Closes the device, in its thread, after the last call; also when `connect` failed."""

    async def open(self, module: Module) -> None:
        """Starts the thread, and waits until it has opened the device."""
        self._thread = self._former = DeviceThread(self.name, self._former)
        await self._thread.run(self.connect)

    async def in_thread(self, function: Callable[[], R]) -> R:
        """Calls a function of the device without delaying other drivers."""
        if self._thread is None:
            raise DeviceError(f"{self.name}: the device is not open")
        return await self._thread.run(function)

    async def close(self) -> None:
        """Ends the thread, without waiting for a device that hangs."""
        if self._thread is not None:
            self._thread.close(self.disconnect)
            self._thread = None
        await super().close()


class BlockingSensor(BlockingDevice, Sensor, Generic[T]):
    """Base of the drivers of sensors that block: `measure` runs in a thread, `publish` in the event loop."""

    @abstractmethod
    def measure(self) -> T:
        """Reads the device, in the thread. Raises: DeviceError, OSError."""

    @abstractmethod
    def publish(self, value: T, now_ns: int) -> bool:
        """Publishes a measurement; `now_ns` is the instant at which the measurement began."""

    async def read(self, now_ns: int) -> bool:
        """Measures once, without delaying other drivers."""
        return self.publish(await self.in_thread(self.measure), now_ns)
