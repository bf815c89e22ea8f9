"""The driver of a core: one timer, one queue of actions, one rule for the milliseconds of the event loop."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Final, Generic

from swarmware.runtime.core import AT_ONCE, Action, Alarm, Core, EventLoop, HardwareClock
from swarmware.runtime.instant import wait_s
from swarmware.runtime.slow import SlowSteps

RETRY_NS: Final = 1_000_000_000
"""Pause after an `on_timer` that failed: what was due still is, and would fail again at once, for ever."""

Boundary = Callable[[Any], AbstractContextManager[None]]
"""Keeps the failure of one action, or of a step at a deadline (None), from the others."""


class CoreDriver(Generic[Action]):
    """Has the actions of a core carried out and wakes it at its deadlines.

    An event goes in as `driver.feed(core.on_event(…, now_ns))`. Actions are carried out one after the other:
    those of an event that an action causes come after those that were there before.
    """

    def __init__(  # the two that a driver needs, and where it differs between shells
        self,
        core: Core[Action],
        perform: Callable[[Action], None],
        *,
        name: str,
        clock: HardwareClock,
        loop: EventLoop,
        settled: Callable[[], None] | None = None,
        boundary: Boundary | None = None,
    ) -> None:
        """`settled`: called when all actions of an event are done, to publish the state they led to."""
        self.core = core
        self._perform = perform if boundary is None else self._perform_within
        self._perform_action = perform
        self._clock = clock
        self._loop = loop
        self._settled = settled
        self._boundary = boundary
        self._queue: deque[Action] = deque()
        self._is_performing = False
        self._is_stopped = False
        self._alarm: Alarm | None = None
        self._alarm_ns = 0
        self._not_before_ns: int | None = None
        self._failure: asyncio.Future[None] | None = None
        self._slow = SlowSteps(f"{name}: timer")

    async def run(self) -> None:
        """Drives until cancelled.

        Raises: what a step at a deadline raised; without `run` the event loop's handler has it.
        """
        self._failure = asyncio.get_running_loop().create_future()
        try:
            self.feed()
            await self._failure
        finally:
            self.stop()

    def feed(self, actions: Iterable[Action] = ()) -> None:
        """Carries out what the core decided upon an event; without actions only its deadline is asked for.

        Raises: what an action raised; those after it follow in a turn of their own.
        """
        if self._is_stopped:
            return
        self._queue.extend(actions)
        if not self._is_performing:
            self._carry_out()

    def defer(self, actions: Iterable[Action] = ()) -> None:
        """As `feed`, in a turn of its own: after the answer that the caller returns."""
        if self._is_stopped:
            return
        self._queue.extend(actions)
        if not self._is_performing:
            self._arm()

    def stop(self) -> None:
        """Nothing is carried out any more, also of what is in the queue."""
        self._is_stopped = True
        self._queue.clear()
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None

    def _carry_out(self) -> None:
        queue, perform, settled = self._queue, self._perform, self._settled
        self._is_performing = True
        try:
            while True:
                while queue:
                    perform(queue.popleft())
                if settled is not None and not self._is_stopped:
                    settled()
                if not queue:
                    break
        finally:
            self._is_performing = False
            self._arm()

    def _perform_within(self, action: Action) -> None:
        with self._boundary(action) if self._boundary is not None else nullcontext():
            self._perform_action(action)

    def _arm(self) -> None:
        """An alarm that is earlier than the deadline stays: it finds that nothing is due, and arms again.

        So a deadline that moves on with each event costs a comparison, and no timer.
        """
        if self._is_stopped:
            return
        due_ns = AT_ONCE if self._queue else self.core.deadline_ns()  # this runs after each event
        if due_ns is not None and (self._alarm is None or due_ns < self._alarm_ns):
            self._set_alarm()

    def _set_alarm(self) -> None:
        due_ns = self._due_ns()
        if due_ns is None or (self._alarm is not None and self._alarm_ns <= due_ns):
            return  # after a failure it is not tried at once
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm_ns = due_ns
        delay_s = 0.0
        if due_ns > self._clock.now_ns():
            # a millisecond at least: the conversion of clocks rounds, and an alarm that is early asks again
            delay_s = max(wait_s(self._clock, due_ns), 0.001)
        self._alarm = self._loop.call_later(delay_s, self._on_alarm)

    def _due_ns(self) -> int | None:
        if self._queue:  # deferred, or after an action that failed
            return AT_ONCE
        due_ns = self.core.deadline_ns()
        if due_ns is not None and self._not_before_ns is not None:
            return max(due_ns, self._not_before_ns)
        return due_ns

    def _on_alarm(self) -> None:
        self._alarm = None
        began_ns = self._clock.now_ns()
        try:
            self._step(began_ns)
        except Exception as error:
            if self._failure is None or self._failure.done():
                raise
            self._failure.set_exception(error)
        finally:
            self._arm()
        self._slow.took(began_ns, self._clock.now_ns())

    def _step(self, now_ns: int) -> None:
        due_ns = self._due_ns()
        if due_ns is None or due_ns > now_ns:
            return
        if self._queue:
            self._carry_out()
            return
        self._not_before_ns = now_ns + RETRY_NS
        with self._boundary(None) if self._boundary is not None else nullcontext():
            actions = self.core.on_timer(now_ns)
            self._not_before_ns = None
            self.feed(actions)
