"""SIGTERM and SIGINT in a program without own handlers: its modules leave the node, then it ends."""

import asyncio
import signal
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Final

_DEFAULTS: Final[dict[signal.Signals, Any]] = {
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGINT: signal.default_int_handler,
}
"""Default handlers, of a program that has not set its own."""


class Ending:
    """Cancels the tasks of one event loop at a signal."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._tasks: dict[asyncio.Task[Any], int] = {}
        self._handled: list[signal.Signals] = []
        self._number = 0

    def enter(self) -> Callable[[type[BaseException] | None], None]:
        """Let a signal cancel the present task, until the returned function is called with the task's
        exception.

        That function raises SystemExit (128 + number) when the signal was the cause.
        """
        task = asyncio.current_task()
        assert task is not None
        if not self._tasks and threading.current_thread() is threading.main_thread():
            for number, default in _DEFAULTS.items():
                if signal.getsignal(number) is default:
                    self._loop.add_signal_handler(number, self._on_signal, number)
                    self._handled.append(number)
        self._tasks[task] = self._tasks.get(task, 0) + 1
        return partial(self._leave, task)

    def _leave(self, task: asyncio.Task[Any], kind: type[BaseException] | None) -> None:
        """Restores the former handlers when the last task has left."""
        self._tasks[task] -= 1
        if self._tasks[task] == 0:
            del self._tasks[task]
        while not self._tasks and self._handled:
            number = self._handled.pop()
            self._loop.remove_signal_handler(number)
            signal.signal(number, _DEFAULTS[number])
        if self._number and kind is asyncio.CancelledError:
            raise SystemExit(128 + self._number)

    def _on_signal(self, number: signal.Signals) -> None:
        self._number = number
        running = [task for task in self._tasks if not task.done()]
        for task in running:
            task.cancel()
        if not running:
            # the modules were entered in tasks that are over: nothing waits for a cancellation
            signal.signal(number, _DEFAULTS[number])
            signal.raise_signal(number)
