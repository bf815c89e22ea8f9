"""Kernel timer with nanosecond resolution, for drivers that need finer instants than the event loop's."""

import asyncio
import ctypes
import os
from typing import Final

from swarmware.errors import SwarmError

_MONOTONIC: Final = 1
_NONBLOCK_CLOEXEC: Final = os.O_NONBLOCK | os.O_CLOEXEC
_ABSOLUTE: Final = 1
"""CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC, TFD_TIMER_ABSTIME. Source: timerfd_create(2)."""
_NS: Final = 1_000_000_000


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


class _Setting(ctypes.Structure):
    _fields_ = [("interval", _Timespec), ("value", _Timespec)]


class PreciseTimer:
    """Waits for instants of the monotonic clock, for one task at a time."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd: int = self._libc.timerfd_create(_MONOTONIC, _NONBLOCK_CLOEXEC)
        if self._fd < 0:
            code = ctypes.get_errno()
            raise SwarmError(f"timerfd_create: {os.strerror(code)}")
        self._loop = asyncio.get_running_loop()
        self._waiter: asyncio.Future[None] | None = None
        self._loop.add_reader(self._fd, self._expired)

    async def until(self, mono_ns: int) -> None:
        """Waits for an instant of the monotonic clock, and never returns before it."""
        at = _Timespec(*divmod(max(mono_ns, 1), _NS))
        setting = _Setting(_Timespec(0, 0), at)
        self._waiter = self._loop.create_future()
        self._libc.timerfd_settime(self._fd, _ABSOLUTE, ctypes.byref(setting), None)
        await self._waiter

    def _expired(self) -> None:
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return  # the timer was set again before its expiry was read
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def close(self) -> None:
        """Closes the timer; a waiting task is not woken."""
        self._loop.remove_reader(self._fd)
        os.close(self._fd)
