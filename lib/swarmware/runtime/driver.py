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
"""Pause after a failed `on_timer`, whose deadline has still passed: it would fail again at once."""

Boundary = Callable[[Any], AbstractContextManager[None]]
"""Contains the failure of one action, or of a step at a deadline (None)."""


class CoreDriver(Generic[Action]):
    """Executes the actions of a core and calls it at its deadlines.

    An event is passed as `driver.feed(core.on_event(…, now_ns))`. Actions are executed one after the other:
    the actions of an event that an action causes follow the queued ones.
    """

    def __init__(  # the two functions of an event loop that a driver needs; shells differ in them
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
        """`settled`: called when all actions of an event are done, to publish the resulting state."""
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
        """Run until cancelled.

        Raises: the exception of a step at a deadline; without `run` the event loop's handler gets it.
        """
        self._failure = asyncio.get_running_loop().create_future()
        try:
            self.feed()
            await self._failure
        finally:
            self.stop()

    def feed(self, actions: Iterable[Action] = ()) -> None:
        """Execute the actions of an event, then arm the timer for the core's deadline.

        Raises: the exception of an action; later actions follow in the next iteration of the loop.
        """
        if self._is_stopped:
            return
        self._queue.extend(actions)
        if not self._is_performing:
            self._carry_out()

    def defer(self, actions: Iterable[Action] = ()) -> None:
        """As `feed`, in the next iteration of the loop: after the reply that the caller returns."""
        if self._is_stopped:
            return
        self._queue.extend(actions)
        if not self._is_performing:
            self._arm()

    def stop(self) -> None:
        """Stop: no further action is executed, queued ones included."""
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
        """Arm the timer; an alarm before the deadline stays: it finds nothing due, and arms again.

        So a deadline that each event postpones costs a comparison, and no new timer.
        """
        if self._is_stopped:
            return
        due_ns = AT_ONCE if self._queue else self.core.deadline_ns()  # this runs after each event
        if due_ns is not None and (self._alarm is None or due_ns < self._alarm_ns):
            self._set_alarm()

    def _set_alarm(self) -> None:
        due_ns = self._due_ns()
        if due_ns is None or (self._alarm is not None and self._alarm_ns <= due_ns):
            return  # after a failure it is not retried at once
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm_ns = due_ns
        delay_s = 0.0
        if due_ns > self._clock.now_ns():
            # at least a millisecond: the conversion of clocks rounds, and an early alarm arms again
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
