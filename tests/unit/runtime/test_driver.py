"""The driver of a core in virtual time: deadlines that move, actions that cause events, what fails."""

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from tests.patience import PATIENCE_S

from swarmware.runtime.core import Alarm
from swarmware.runtime.driver import RETRY_NS, CoreDriver
from swarmware.runtime.slow import SLOW_NS
from swarmware.testing.virtual import VirtualClock, VirtualTime

MS = 1_000_000


class Script:
    """A core with one deadline; each `on_timer` is noted, and gives the actions that are prepared."""

    def __init__(self) -> None:
        self.due_ns: int | None = None
        self.woken_ns: list[int] = []
        self.brings: list[str] = []
        self.again_ns: int | None = None
        self.fails = 0

    def on_event(self, *actions: str, due_ns: int | None) -> list[str]:
        self.due_ns = due_ns
        return list(actions)

    def on_timer(self, now_ns: int) -> list[str]:
        self.woken_ns.append(now_ns)
        if self.fails:
            self.fails -= 1
            raise RuntimeError("the core is broken")
        self.due_ns = None if self.again_ns is None else now_ns + self.again_ns
        return self.brings

    def deadline_ns(self) -> int | None:
        return self.due_ns


class Shell:
    """Carries actions out by noting them; some do more."""

    def __init__(self, time: VirtualTime, core: Script) -> None:
        self.time = time
        self.core = core
        self.done: list[str] = []
        self.does: dict[str, Callable[[], None]] = {}
        self.driver = time.drive(core, self.perform, settled=self.settled)
        self.settled_after: list[int] = []

    def perform(self, action: str) -> None:
        self.done.append(action)
        self.does.get(action, lambda: None)()

    def settled(self) -> None:
        self.settled_after.append(len(self.done))


@pytest.fixture
def shell() -> Shell:
    return Shell(VirtualTime(), Script())


def fail() -> None:
    raise RuntimeError("the action failed")


def test_actions_run_in_order_before_state_settles(
    shell: Shell,
) -> None:
    shell.driver.feed(shell.core.on_event("one", "two", due_ns=None))
    assert shell.done == ["one", "two"]
    assert shell.settled_after == [2]
    shell.time.run_for(10)
    assert shell.core.woken_ns == []


def test_core_wakes_at_each_deadline(shell: Shell) -> None:
    shell.core.brings, shell.core.again_ns = ["due"], 20 * MS
    shell.driver.feed(shell.core.on_event(due_ns=5 * MS))
    shell.time.run_until(50 * MS)
    assert shell.core.woken_ns == [5 * MS, 25 * MS, 45 * MS]
    assert shell.done == ["due"] * 3


def test_deadline_within_millisecond_is_met_never_early(shell: Shell) -> None:
    shell.driver.feed(shell.core.on_event(due_ns=5 * MS + 1))
    shell.time.run_for(1)
    assert shell.core.woken_ns == [6 * MS]


def test_passed_deadline_wakes_core_in_next_turn(shell: Shell) -> None:
    shell.time.run_until(70 * MS)
    shell.driver.feed(shell.core.on_event(due_ns=-(1 << 63)))
    assert shell.core.woken_ns == []
    shell.time.run_until(70 * MS)
    assert shell.core.woken_ns == [70 * MS]


def test_a_deadline_that_moves_earlier_is_kept(shell: Shell) -> None:
    shell.driver.feed(shell.core.on_event(due_ns=50 * MS))
    shell.driver.feed(shell.core.on_event(due_ns=10 * MS))
    shell.time.run_for(1)
    assert shell.core.woken_ns == [10 * MS]


def test_deadline_that_moves_later_wakes_core_only_then(shell: Shell) -> None:
    shell.driver.feed(shell.core.on_event(due_ns=10 * MS))
    shell.driver.feed(shell.core.on_event(due_ns=50 * MS))
    shell.time.run_for(1)
    assert shell.core.woken_ns == [50 * MS]


def test_a_deadline_that_is_taken_back_wakes_nobody(shell: Shell) -> None:
    shell.driver.feed(shell.core.on_event(due_ns=10 * MS))
    shell.driver.feed(shell.core.on_event(due_ns=None))
    shell.time.run_for(1)
    assert shell.core.woken_ns == []


def test_early_alarm_asks_for_rest() -> None:
    class Early(VirtualTime):
        def call_later(self, delay: float, callback: Callable[[], None], /) -> Alarm:  # type: ignore[override]
            return super().call_later(max(delay - 0.001, 0.0005), callback)

    time, core = Early(), Script()
    shell = Shell(time, core)
    shell.driver.feed(core.on_event(due_ns=10 * MS))
    time.run_for(1)
    assert len(core.woken_ns) == 1
    assert 10 * MS <= core.woken_ns[0] <= 11 * MS


def test_late_alarm_wakes_core_once_with_time() -> None:
    class Late(VirtualTime):
        def call_later(self, delay: float, callback: Callable[[], None], /) -> Alarm:  # type: ignore[override]
            return super().call_later(delay + 0.3, callback)

    time, core = Late(), Script()
    shell = Shell(time, core)
    shell.driver.feed(core.on_event(due_ns=10 * MS))
    time.run_for(1)
    assert core.woken_ns == [310 * MS]


@pytest.mark.parametrize("drift_ppm", [-80.0, 0.0, 3.7, 80.0])
@pytest.mark.parametrize("offset_s", [-12.345_678_901, 0.0, 99.000_000_7])
def test_node_clock_wastes_no_alarm(offset_s: float, drift_ppm: float) -> None:
    time, core = VirtualTime(start_ns=123_456_789), Script()
    clock = VirtualClock(time, offset_s, drift_ppm)
    driver = time.drive(core, lambda action: None, clock=clock)
    for after_ns in (1, MS, 7 * MS + 3, 10_000 * MS):
        due_ns = clock.now_ns() + after_ns
        driver.feed(core.on_event(due_ns=due_ns))
        while core.due_ns is not None:
            assert time.step()
        assert 0 <= core.woken_ns[-1] - due_ns <= 2 * MS
    assert len(core.woken_ns) == 4


def test_actions_of_caused_event_follow_existing_ones(
    shell: Shell,
) -> None:
    shell.does["one"] = lambda: shell.driver.feed(shell.core.on_event("caused", due_ns=9 * MS))
    shell.driver.feed(shell.core.on_event("one", "two", due_ns=None))
    assert shell.done == ["one", "two", "caused"]
    assert shell.settled_after == [3], "the state is published once, not half-way"
    shell.time.run_for(1)
    assert shell.core.woken_ns == [9 * MS]


def test_deferred_actions_precede_due_ones(shell: Shell) -> None:
    shell.core.brings = ["due"]
    shell.driver.defer(shell.core.on_event("one", due_ns=0))
    assert shell.done == []
    shell.driver.defer(["two"])
    shell.time.run_until(0)
    assert shell.done == ["one", "two", "due"]
    shell.does["act"] = lambda: shell.driver.defer(["after"])
    shell.driver.feed(["act", "next"])
    assert shell.done[3:] == ["act", "next", "after"]


def test_deferred_actions_run_although_clock_advances() -> None:
    class Busy(VirtualClock):
        def now_ns(self) -> int:
            self._time.now_ns += 1
            return super().now_ns()

    time = VirtualTime()
    done: list[str] = []
    driver = time.drive(Script(), done.append, clock=Busy(time))
    driver.defer(["one"])
    for _ in range(3):
        time.step()
    assert done == ["one"]


def test_settling_may_cause_an_event_too(shell: Shell) -> None:
    def settled() -> None:
        shell.settled()
        if len(shell.settled_after) == 1:
            shell.driver.feed(["follows"])

    shell.driver = shell.time.drive(shell.core, shell.perform, settled=settled)
    shell.driver.feed(["one"])
    assert shell.done == ["one", "follows"]
    assert shell.settled_after == [1, 2]


def test_failed_action_is_raised_and_rest_continue(shell: Shell) -> None:
    shell.does["one"] = fail
    with pytest.raises(RuntimeError, match="the action failed"):
        shell.driver.feed(shell.core.on_event("one", "two", due_ns=30 * MS))
    assert shell.done == ["one"]
    shell.time.run_until(0)
    assert shell.done == ["one", "two"]
    shell.time.run_for(1)
    assert shell.core.woken_ns == [30 * MS]


def test_core_failing_at_deadline_is_retried_after_pause(shell: Shell) -> None:
    shell.core.fails, shell.core.brings = 2, ["due"]
    shell.driver.feed(shell.core.on_event(due_ns=10 * MS))
    for _ in range(2):
        with pytest.raises(RuntimeError, match="the core is broken"):
            shell.time.run_for(30)
    shell.time.run_for(30)
    first_ns, second_ns, third_ns = shell.core.woken_ns
    assert (second_ns - first_ns, third_ns - second_ns) == (RETRY_NS, RETRY_NS)
    assert shell.done == ["due"]


def test_boundary_isolates_failed_actions_and_deadlines() -> None:
    refused: list[str] = []

    @contextmanager
    def boundary(what: str | None) -> Iterator[None]:
        try:
            yield
        except RuntimeError as error:
            refused.append(f"{what}: {error}")

    time, core = VirtualTime(), Script()
    done: list[str] = []

    def perform(action: str) -> None:
        if action == "bad":
            fail()
        done.append(action)

    driver = CoreDriver(core, perform, name="x", clock=VirtualClock(time), loop=time, boundary=boundary)
    core.fails = 1
    driver.feed(core.on_event("bad", "good", due_ns=10 * MS))
    time.run_until(500 * MS)
    assert done == ["good"]
    assert refused == ["bad: the action failed", "None: the core is broken"]
    assert core.woken_ns == [10 * MS], "once, and not in a circle"
    time.run_for(2)
    assert core.due_ns is None


def test_a_stopped_driver_wakes_nobody_and_does_nothing(shell: Shell) -> None:
    shell.driver.feed(shell.core.on_event(due_ns=10 * MS))
    shell.driver.stop()
    shell.driver.feed(shell.core.on_event("one", due_ns=20 * MS))
    shell.time.run_for(1)
    assert (shell.core.woken_ns, shell.done, shell.settled_after) == ([], [], [0])


def test_action_that_stops_driver_is_last(shell: Shell) -> None:
    shell.does["one"] = shell.driver.stop
    shell.driver.feed(shell.core.on_event("one", "two", due_ns=10 * MS))
    shell.time.run_for(1)
    assert (shell.done, shell.core.woken_ns, shell.settled_after) == (["one"], [], [])


def test_slow_step_at_deadline_is_reported_rarely(shell: Shell, caplog: pytest.LogCaptureFixture) -> None:
    def work() -> None:
        shell.time.now_ns += SLOW_NS + MS

    shell.does["work"] = work
    shell.core.brings, shell.core.again_ns = ["work"], 100 * MS
    shell.driver.feed(shell.core.on_event(due_ns=10 * MS))
    with caplog.at_level(logging.WARNING, "swarm.slow"):
        shell.time.run_until(5_000 * MS)
    assert [record.getMessage() for record in caplog.records] == [
        "Script: timer held the event loop for 51 ms"
    ]


def test_service_ends_with_what_failed_at_deadline() -> None:
    core = Script()
    core.fails, core.due_ns = 1, 0

    async def service() -> None:
        time = VirtualTime(start_ns=1)
        driver = CoreDriver(
            core,
            lambda action: None,
            name="x",
            clock=VirtualClock(time),
            loop=asyncio.get_running_loop(),
        )
        await driver.run()

    with pytest.raises(RuntimeError, match="the core is broken"):
        asyncio.run(asyncio.wait_for(service(), PATIENCE_S))


def test_a_service_that_is_cancelled_leaves_no_alarm() -> None:
    core = Script()
    time = VirtualTime()
    driver = time.drive(core, lambda action: None)

    async def service() -> None:
        core.due_ns = 10 * MS
        task = asyncio.create_task(driver.run())
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.wait([task])

    asyncio.run(service())
    time.run_for(1)
    assert core.woken_ns == []
