"""Reports steps that block the event loop too long: they delay all services of the process.

`slow_callback_duration` of asyncio and uvloop works in their debug mode only, which records a stack for each
callback and task. This reads the clock twice for each step.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Generator
from contextvars import Context
from typing import Any, Final

SLOW_NS: Final = 50_000_000
"""Two and a half periods of the fastest loop, the simulation's 50 Hz."""
QUIET_NS: Final = 10_000_000_000
"""Minimum period between two reports of one task."""

log = logging.getLogger("swarm.slow")


class _Timed(Coroutine[Any, Any, Any]):
    """A coroutine whose steps are timed."""

    __slots__ = ("_coroutine", "_report")

    def __init__(self, coroutine: Coroutine[Any, Any, Any], report: Callable[[int, int], None]) -> None:
        self._coroutine = coroutine
        self._report = report

    def send(self, value: Any) -> Any:
        began_ns = time.monotonic_ns()
        try:
            return self._coroutine.send(value)
        finally:
            # in `finally`: a step that raises has held the loop as well
            ended_ns = time.monotonic_ns()
            if ended_ns - began_ns > SLOW_NS:
                self._report(began_ns, ended_ns)

    def throw(self, *error: Any) -> Any:
        return self._coroutine.throw(*error)

    def close(self) -> None:
        self._coroutine.close()

    def __await__(self) -> Generator[Any, None, Any]:
        return self._coroutine.__await__()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._coroutine, name)  # cr_frame, cr_code …: used by stack traces and repr


class SlowSteps:
    """Reports steps of one task or timer that held the event loop for more than 50 ms."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._reported_ns: int | None = None

    def took(self, began_ns: int, ended_ns: int) -> None:
        """Evaluate the duration of a step that has ended."""
        if ended_ns - began_ns <= SLOW_NS:
            return
        if self._reported_ns is None or ended_ns - self._reported_ns >= QUIET_NS:
            self._reported_ns = ended_ns
            log.warning("%s held the event loop for %d ms", self._name, (ended_ns - began_ns) // 1_000_000)


def warn_if_slow(loop: asyncio.AbstractEventLoop) -> None:
    """Log each task of the loop that blocks it for more than 50 ms, from now on."""
    tasks: dict[str, SlowSteps] = {}

    def report(began_ns: int, ended_ns: int) -> None:
        task = asyncio.current_task(loop)
        name = "a task" if task is None else task.get_name()
        # by name: tasks of one kind come and go, and share one report
        tasks.setdefault(name, SlowSteps(name)).took(began_ns, ended_ns)

    def make(
        loop: asyncio.AbstractEventLoop, coroutine: Any, *, context: Context | None = None, **named: Any
    ) -> asyncio.Task[Any]:
        return asyncio.Task(_Timed(coroutine, report), loop=loop, context=context, **named)

    loop.set_task_factory(make)
