"""A module's own part of health monitoring: checks, conditions, actions, and reports to the daemon (S1.9)."""

import asyncio
import inspect
import math
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final, Generic, TypeVar

import msgspec

from swarmware.delivery import Status
from swarmware.errors import InvalidInput, SwarmError
from swarmware.health.condition import Condition
from swarmware.health.judge import Judge
from swarmware.module import BoardWriter, Module
from swarmware.names import segment
from swarmware.types.health import (
    OK_STATE,
    CheckRegistration,
    CheckReport,
    CheckReports,
    Level,
    StateRule,
    default_level,
)

D = TypeVar("D")

ADDRESS: Final = "sys/health/register"
REPORT_S: Final = 1.0
"""Reports are repeated so often: a silence of three is a fault."""
RETRY_S: Final = (0.2, 0.5, 1.0, 2.0, 5.0)
"""Pauses while no monitor takes the registration; there is no order of start."""
FREEZE_CHARACTERS: Final = 200
FAILED_STATE: Final = "no data"
"""The data callback raised a SwarmError."""

Data = Callable[[], D | Awaitable[D]]
Criterion = Callable[[D], str]
Action = Callable[[D], Awaitable[None] | None]


class Check(Generic[D]):
    """One check: data at a frequency, a criterion that makes a state of it, actions for states."""

    def __init__(
        self,
        registration: CheckRegistration,
        data: Data[D],
        criterion: Criterion[D],
        actions: Mapping[str, Action[D]],
        started_ns: int,
    ) -> None:
        self.registration = registration
        self._data = data
        self._criterion = criterion
        self._actions = actions
        self._judge = Judge(
            confirm_n=registration.confirm_n,
            confirm_m=registration.confirm_m,
            grace_until_ns=started_ns + round(registration.grace_s * 1e9),
        )
        self._freeze = ""
        self._stamp_ns = started_ns

    @property
    def state(self) -> str:
        """The believed state."""
        return self._judge.state

    async def look(self, now_ns: int) -> bool:
        """Runs the triple once; True when another state is believed, whose action was run."""
        data: D | None = None
        try:
            result = self._data()
            data = await result if inspect.isawaitable(result) else result
            state = self._criterion(data)
            self._freeze = str(data)[:FREEZE_CHARACTERS]
        except SwarmError as error:
            state = FAILED_STATE
            self._freeze = str(error)[:FREEZE_CHARACTERS]
        self._stamp_ns = now_ns
        if not self._judge.on_result(state, now_ns):
            return False
        action = self._actions.get(state)
        if action is not None and data is not None:
            done = action(data)
            if inspect.isawaitable(done):
                await done
        return True

    def report(self) -> CheckReport:
        """What the monitor is told."""
        judge = self._judge
        seen = judge.seen if judge.seen != judge.state else ""
        return CheckReport(self.registration.check, judge.state, self._stamp_ns, seen, self._freeze)


class HealthMonitor:
    """`HealthMonitor(module)`: registers checks, runs them in this module, keeps the daemon told.

    Nothing acts on other modules: an action runs where it was registered (S1.28).
    """

    def __init__(self, module: Module) -> None:
        self._module = module
        self._checks: dict[str, Check[Any] | Condition] = {}
        self._tasks: dict[str, list[asyncio.Task[Any]]] = {}
        self._board: BoardWriter[CheckReports] | None = None
        self._opening = False

    async def register(
        self,
        name: str,
        *,
        frequency_hz: float,
        data: Data[D],
        criterion: Criterion[D],
        actions: Mapping[str, Action[D]] | None = None,
        levels: Mapping[str, Level] | None = None,
        confirm: tuple[int, int] = (1, 1),
        clear_s: float = 5.0,
        grace_s: float = 0.0,
        description: str = "",
    ) -> Check[D]:
        """Starts a check; `data` and actions may be coroutine functions, an action gets the data.

        `levels`: how bad each state is; else `warn` is a warning and every other state but `ok` an error.
        `confirm`: n of the last m results must agree. An error in a callback ends the module; but a
        SwarmError of `data` is the state "no data".
        Raises: InvalidInput when the name is taken, or a number makes no sense.
        """
        module = self._module
        if name in self._checks:
            raise InvalidInput(f"check {name!r}: registered already by {module.id}; expected another name")
        if not (math.isfinite(frequency_hz) and frequency_hz > 0):
            raise InvalidInput(f"check {name!r}: {frequency_hz} Hz; expected more than 0")
        named = {*(levels or {}), *(actions or {})} - {OK_STATE}
        rules = tuple(
            StateRule(
                state,
                (levels or {}).get(state, default_level(state)),
                (state,) if actions and state in actions else (),
            )
            for state in sorted(named)
        )
        registration = CheckRegistration(
            check=f"{module.name}/{name}",
            app=module.id,
            frequency_hz=frequency_hz,
            states=rules,
            confirm_n=confirm[0],
            confirm_m=confirm[1],
            clear_s=clear_s,
            grace_s=grace_s,
            description=description,
        )
        try:
            check = Check(registration, data, criterion, actions or {}, module.now_ns())
        except ValueError as error:
            raise InvalidInput(f"check {name!r}: {error}") from error
        self._add(name, check)
        self._tasks[name].append(module.start(self._run(check), f"check {name}"))
        return check

    def report(
        self,
        name: str,
        state: str = OK_STATE,
        *,
        level: Level | None = None,
        detail: str = "",
        clear_s: float = 5.0,
        description: str = "",
    ) -> None:
        """States a condition that the module knows without asking: a state other than `ok` is a fault.

        To be called as often as one likes; the first call of a name registers it with `clear_s` and
        `description`, what changes later is `state`, `level` and `detail`. `level`: as in `register`.
        Raises: InvalidInput when the name is a check's that `register` runs.
        """
        module = self._module
        condition = self._checks.get(name)
        if condition is None:
            registration = CheckRegistration(
                check=f"{module.name}/{name}",
                app=module.id,
                frequency_hz=1 / REPORT_S,
                clear_s=clear_s,
                description=description,
            )
            condition = Condition(registration, module.now_ns())
            self._add(name, condition)
        if not isinstance(condition, Condition):
            raise InvalidInput(f"check {name!r}: {module.id} runs it itself; expected another name")
        detail = detail[:FREEZE_CHARACTERS]
        if condition.set(state, default_level(state) if level is None else level, detail, module.now_ns()):
            module.log.info("condition %s: %s %s", condition.registration.check, state, detail)
            self._report()

    async def withdraw(self, name: str) -> None:
        """Ends a check; its fault, if there is one, is over."""
        check = self._checks.pop(name)
        for task in self._tasks.pop(name):
            task.cancel()
        self._report()
        gone = msgspec.structs.replace(check.registration, withdrawn=True)
        await self._module.send(ADDRESS, gone)

    def _add(self, name: str, check: Check[Any] | Condition) -> None:
        self._checks[name] = check
        self._tasks[name] = [self._module.start(self._tell(check.registration), f"tell of check {name}")]
        if not self._opening:
            self._opening = True
            self._module.start(self._repeat(), "report checks")

    async def _repeat(self) -> None:
        """Opens the board, then reports again and again: silence is a fault."""
        module = self._module
        suffix = "" if module.instance == 1 else f"_{module.instance}"
        self._board = await module.writer(
            f"health/checks/{segment(module.name)}{suffix}",
            CheckReports,
            rate_hz=1 / REPORT_S,
            link="request",
            description=f"Checks that {module.name} runs itself",
        )
        self._report()
        async for _ in module.every(REPORT_S):
            self._report()

    async def _run(self, check: Check[D]) -> None:
        async for _ in self._module.every(1 / check.registration.frequency_hz):
            if await check.look(self._module.now_ns()):
                self._module.log.info("check %s: %s", check.registration.check, check.state)
                self._report()

    def _report(self) -> None:
        if self._board is not None:
            reports = tuple(check.report() for check in self._checks.values())
            self._board.write(CheckReports(self._module.id, reports))

    async def _tell(self, registration: CheckRegistration) -> None:
        """Registers with the monitor, and again with each new start of it that may have lost its journal."""
        told_ns = -1
        attempt = 0
        while True:
            monitor = self._module.node.table.named("health")
            if monitor is not None and monitor.started_ns != told_ns:
                outcome = await self._module.send(ADDRESS, registration)
                if outcome.status is Status.DELIVERED:
                    told_ns = monitor.started_ns
                    attempt = 0
            pause_s = REPORT_S if told_ns >= 0 else RETRY_S[min(attempt, len(RETRY_S) - 1)]
            attempt += 1
            await asyncio.sleep(pause_s)
            self._module.node.table.refresh()
