"""Waits for a callback, by futures with a deadline, without tasks."""

import asyncio


class Wakeup:
    """The waiters for one condition."""

    __slots__ = ("_loop", "_waiters")

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiters: list[asyncio.Future[bool]] = []

    @property
    def awaited(self) -> bool:
        """Whether there is a waiter."""
        return bool(self._waiters)

    def notify(self) -> None:
        """Wake all tasks that wait."""
        for future in self._waiters:
            if not future.done():
                future.set_result(True)

    async def wait(self, timeout_s: float | None) -> bool:
        """Wait for the next `notify`; False when the time is over before."""
        future: asyncio.Future[bool] = self._loop.create_future()
        self._waiters.append(future)
        timer = None if timeout_s is None else self._loop.call_later(max(0.0, timeout_s), _expire, future)
        try:
            return await future
        finally:
            # also on cancellation, so that no dead future stays
            self._waiters.remove(future)
            if timer is not None:
                timer.cancel()

    async def until(self, deadline: "Deadline") -> bool:
        """Wait for the next `notify`; False when the deadline has passed before."""
        remaining_s = deadline.remaining_s()
        return remaining_s != 0.0 and await self.wait(remaining_s)


def _expire(future: "asyncio.Future[bool]") -> None:
    if not future.done():
        future.set_result(False)


class Deadline:
    """A point in time that limits several waits."""

    __slots__ = ("_deadline_s", "_loop")

    def __init__(self, timeout_s: float | None) -> None:
        self._loop = asyncio.get_running_loop()
        self._deadline_s = None if timeout_s is None else self._loop.time() + timeout_s

    def remaining_s(self) -> float | None:
        """Time left, 0 when it is over, or None without a limit."""
        return None if self._deadline_s is None else max(0.0, self._deadline_s - self._loop.time())
