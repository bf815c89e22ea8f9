"""A module's own part of health monitoring: checks, conditions, actions, and reports to the daemon (S1.9)."""

import asyncio
import inspect
import math
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final, Generic, TypeVar

import msgspec

from swarmware.errors import InvalidInput, SwarmError
from swarmware.health.debouncer import Debouncer
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.runtime.backoff import pause_after
from swarmware.transport.delivery.outcome import Status
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
"""Period of repeated reports: three missing ones are a fault."""
RETRY_S: Final = (0.2, 0.5, 1.0, 2.0, 5.0)
"""Pauses while the monitor does not accept the registration."""
FREEZE_FRAME_CHARACTERS: Final = 200
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
        self._debouncer = Debouncer(
            confirm_n=registration.confirm_n,
            confirm_m=registration.confirm_m,
            grace_until_ns=started_ns + round(registration.grace_s * 1e9),
        )
        self._freeze_frame = ""
        self._stamp_ns = started_ns

    @property
    def state(self) -> str:
        """The state of this check that the debouncer has confirmed."""
        return self._debouncer.confirmed

    async def sample(self, now_ns: int) -> bool:
        """Take a sample; True if another state is confirmed and its action was run."""
        data: D | None = None
        try:
            result = self._data()
            data = await result if inspect.isawaitable(result) else result
            # the criterion of a module may fail as well, which the check then reports
            state = self._criterion(data)
            self._freeze_frame = str(data)[:FREEZE_FRAME_CHARACTERS]
        except SwarmError as error:
            state = FAILED_STATE
            self._freeze_frame = str(error)[:FREEZE_FRAME_CHARACTERS]
        self._stamp_ns = now_ns
        if not self._debouncer.on_sample(state, now_ns):
            return False
        action = self._actions.get(state)
        if action is not None and data is not None:
            done = action(data)
            if inspect.isawaitable(done):
                await done
        return True

    def report(self) -> CheckReport:
        """Report for the monitor."""
        confirmed, raw = self._debouncer.confirmed, self._debouncer.raw
        seen = raw if raw != confirmed else ""
        return CheckReport(self.registration.check, confirmed, self._stamp_ns, seen, self._freeze_frame)


class ReportedCondition:
    """A condition that a module reports itself when something happens, without periodic sampling."""

    def __init__(self, registration: CheckRegistration, now_ns: int) -> None:
        self.registration = registration
        self._state = OK_STATE
        self._level: Level = "ok"
        self._detail = ""
        self._stamp_ns = now_ns

    def set(self, state: str, level: Level, detail: str, now_ns: int) -> bool:
        """Set the state; True if it or its level changed. A new detail alone waits for the next report."""
        self._stamp_ns = now_ns
        self._detail = detail
        before = (self._state, self._level)
        self._state, self._level = state, level
        return before != (state, level)

    def report(self) -> CheckReport:
        """Report for the monitor."""
        return CheckReport(
            self.registration.check, self._state, self._stamp_ns, freeze=self._detail, level=self._level
        )


class HealthMonitor:
    """`HealthMonitor(module)`: registers checks, runs them in this module, reports them to the daemon.

    An action runs in the module that registered it, never in another one (S1.28).
    """

    def __init__(self, module: Module) -> None:
        self._module = module
        self._checks: dict[str, Check[Any] | ReportedCondition] = {}
        self._tasks: dict[str, list[asyncio.Task[Any]]] = {}
        self._board: BoardWriter[CheckReports] | None = None
        self._opening = False
        self._repairs = module.node.repairs
        self._changed: set[asyncio.Event] = set()
        """Events that let a registration be repeated, one for each check."""

    def register(  # noqa: PLR0913 - the public call of a module, with defaults
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
        """Start a check; `data` and actions may be coroutine functions, an action receives the data.

        `levels`: level of each state; without it `warn` is a warning and every other state but `ok` an error.
        `confirm`: n of the last m results must agree. An error in a callback ends the module; but a
        SwarmError of `data` is the state "no data".
        Raises: InvalidInput when the name is in use, or a number is out of range.
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
        except InvalidInput as error:
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
        """Report a condition that the module knows without sampling: a state other than `ok` is a fault.

        The first call of a name registers it with `clear_s` and `description`; later calls change `state`,
        `level` and `detail`. `level`: as in `register`.
        Raises: InvalidInput when `register` runs a check of this name.
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
            condition = ReportedCondition(registration, module.now_ns())
            self._add(name, condition)
        if not isinstance(condition, ReportedCondition):
            raise InvalidInput(f"check {name!r}: {module.id} runs it itself; expected another name")
        # bounded, because the board repeats it every second
        detail = detail[:FREEZE_FRAME_CHARACTERS]
        if condition.set(state, default_level(state) if level is None else level, detail, module.now_ns()):
            module.log.info("condition %s: %s %s", condition.registration.check, state, detail)
            self._write_reports()

    async def withdraw(self, name: str) -> None:
        """End a check and clear its fault."""
        check = self._checks.pop(name)
        for task in self._tasks.pop(name):
            task.cancel()
        self._write_reports()
        # announced, as silence alone would be a fault of the check
        gone = msgspec.structs.replace(check.registration, withdrawn=True)
        await self._module.send(ADDRESS, gone)

    def _add(self, name: str, check: Check[Any] | ReportedCondition) -> None:
        self._checks[name] = check
        self._tasks[name] = [
            self._module.start(self._keep_registered(check.registration), f"register check {name}")
        ]
        if not self._opening:
            self._opening = True
            self._module.start(self._repeat_reports(), "report checks")

    async def _repeat_reports(self) -> None:
        """Open the board and write a report every period: silence is a fault."""
        module = self._module
        self._board = module.writer(
            paths.checks(module.name, module.instance),
            CheckReports,
            rate_hz=1 / REPORT_S,
            link="request",
            description=f"Checks that {module.name} runs itself",
        )
        self._write_reports()
        async for _ in module.every(REPORT_S):
            self._write_reports()
            if self._repairs != module.node.repairs:
                # while our application file was missing, we had left for the monitor, which forgot our checks
                self._repairs = module.node.repairs
                for changed in self._changed:
                    changed.set()

    async def _run(self, check: Check[D]) -> None:
        async for _ in self._module.every(1 / check.registration.frequency_hz):
            if await check.sample(self._module.now_ns()):
                self._module.log.info("check %s: %s", check.registration.check, check.state)
                self._write_reports()

    def _write_reports(self) -> None:
        if self._board is not None:
            reports = tuple(check.report() for check in self._checks.values())
            self._board.write(CheckReports(self._module.id, reports))

    async def _keep_registered(self, registration: CheckRegistration) -> None:
        """Register with the monitor, and again after each start of it, which may have lost its journal."""
        node = self._module.node
        changed = asyncio.Event()
        self._changed.add(changed)
        registered: tuple[int, int] | None = None
        failures = 0
        subscription = node.applications.subscribe(lambda _: changed.set())
        try:
            while True:
                # Before the state is read: a change during the registration wakes the loop again.
                changed.clear()
                monitor, repairs = node.table.named("health"), node.repairs
                # the start identifies the monitor: a restarted one has forgotten the registrations
                if monitor is None or registered == (monitor.started_ns, repairs):
                    await changed.wait()
                elif (await self._module.send(ADDRESS, registration)).status is Status.DELIVERED:
                    registered = (monitor.started_ns, repairs)
                    failures = 0
                else:
                    failures += 1
                    await asyncio.sleep(pause_after(failures, RETRY_S))
        finally:
            subscription.close()
            self._changed.discard(changed)
