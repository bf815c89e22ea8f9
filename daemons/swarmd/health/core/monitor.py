"""The monitor: makes faults and one state of the platform of looks, values, reports and deaths."""

from collections.abc import Callable
from typing import Final, Literal

import msgspec

from swarmd.health.core.apps import APP_LEVELS, DIED, App, Apps
from swarmd.health.core.faults import FaultBook, Seen
from swarmd.health.core.reports import ReportBook, Reported
from swarmd.health.core.rules import AGE_LEVELS, AgeRule, LimitRule
from swarmware.names import Pattern
from swarmware.resource import Resource
from swarmware.types.health import (
    OK_STATE,
    CheckRegistration,
    CheckReports,
    CheckState,
    Fault,
    HealthState,
    Level,
    default_level,
)
from swarmware.types.system import AppStatus

FAULTS_LIMIT: Final = 16
"""Names of faults in the state that the whole swarm may read."""
BATTERY_PATH: Final = "power/battery"
BATTERY_STEP: Final = 0.05
"""The ratio is rounded to this: the state travels on change."""

Guard = Literal["alive", "hung", "absent"]


class Limit(msgspec.Struct, frozen=True):
    """A limit of one field of one resource, ready to be applied."""

    check: str
    path: str
    field: str
    criterion: Callable[[], Callable[[float], str]]
    """Makes a criterion with a memory of its own."""
    confirm: tuple[int, int]


class Present(msgspec.Struct, frozen=True):
    """An application as its file says it."""

    app_id: str
    name: str
    pid: int
    started_ns: int
    resources: tuple[Resource, ...] = ()


class MonitorCore:
    """Everything the monitor knows. Calls collect changes of faults; `take` gives them."""

    def __init__(
        self,
        *,
        limits: tuple[Limit, ...],
        sensors: tuple[str, ...],
        ignore: tuple[str, ...],
        grace_s: float,
        clear_s: float,
        hung_s: float,
    ) -> None:
        self.faults = FaultBook(clear_s)
        self.reports = ReportBook()
        self.apps = Apps(hung_s)
        self.guard: Guard = "absent"
        self._limits = limits
        self._sensors = [Pattern(text) for text in sensors]
        self._ignore = [Pattern(text) for text in ignore]
        self._grace_ns = round(grace_s * 1e9)
        self._ages: dict[str, AgeRule] = {}
        self._rules: dict[str, LimitRule] = {}
        self._expected: dict[str, Resource] = {}
        self._changed: list[Fault] = []

    def expect(self, resources: tuple[Resource, ...]) -> None:
        """What the template says the platform has: sensors that nobody provides are not valid."""
        self._expected = {resource.path: resource for resource in resources if self._is_sensor(resource.path)}

    def take(self) -> list[Fault]:
        """Changes of faults since the last time."""
        changed, self._changed = self._changed, []
        return changed

    # -- applications and their resources

    def on_present(self, entry: Present, now_ns: int) -> None:
        """An application file is there; its resources are watched from now on."""
        app_id, resources = entry.app_id, entry.resources
        before = self.apps.get(app_id)
        was_dead = before is not None and before.state == DIED
        old_paths = set(before.resources) if before is not None else set()
        app = self.apps.on_present(
            app_id, entry.name, entry.pid, {one.path: one for one in resources}, now_ns
        )
        if was_dead:
            self._settle_app(app, now_ns)
        for path in old_paths - set(app.resources):
            self._unwatch(path, now_ns)
        for resource in resources:
            self._watch(resource, entry.started_ns + self._grace_ns)

    def on_died(self, app_id: str, now_ns: int) -> None:
        """A process ended without goodbye: its resources are still expected."""
        app = self.apps.on_died(app_id, now_ns)
        if app is not None:
            self._settle_app(app, now_ns)

    def on_left(self, app_id: str, now_ns: int) -> None:
        """An application said goodbye: nothing of it is missed."""
        app = self.apps.on_left(app_id)
        if app is None:
            return
        self._note(self.faults.forget(app.check, now_ns))
        for path in app.resources:
            self._unwatch(path, now_ns)
        for check in self.reports.of(app_id):
            self.withdraw(check, now_ns)

    def on_status(self, app: App, status: AppStatus, now_ns: int) -> None:
        """The beat of an application."""
        if self.apps.on_status(app, status, now_ns):
            self._settle_app(app, now_ns)

    def _settle_app(self, app: App, now_ns: int) -> None:
        self._settle(
            Seen(app.check, app.state, APP_LEVELS[app.state], f"pid {app.pid}, beat {app.beat}"), "", now_ns
        )

    def _watch(self, resource: Resource, grace_until_ns: int) -> None:
        path = resource.path
        if any(pattern.matches(path) for pattern in self._ignore):
            return
        if path not in self._ages and AgeRule.applies(resource):
            self._ages[path] = AgeRule(resource, grace_until_ns)
        for limit in self._limits:
            if limit.path == path and limit.check not in self._rules:
                self._rules[limit.check] = LimitRule(
                    limit.check, path, limit.field, limit.criterion(), limit.confirm, grace_until_ns
                )

    def _unwatch(self, path: str, now_ns: int) -> None:
        if (age := self._ages.pop(path, None)) is not None:
            self._note(self.faults.forget(age.check, now_ns))
        for rule in [rule for rule in self._rules.values() if rule.path == path]:
            del self._rules[rule.check]
            self._note(self.faults.forget(rule.check, now_ns))

    # -- rules of the monitor

    def ages(self) -> list[AgeRule]:
        """Resources whose age is watched."""
        return list(self._ages.values())

    def limits(self) -> list[LimitRule]:
        """Values that are watched."""
        return list(self._rules.values())

    def on_look(self, age: AgeRule, position: int, now_ns: int) -> None:
        """Where the ring of a resource stands."""
        age.on_look(position, now_ns)
        if age.in_grace(now_ns):
            return
        if age.state == OK_STATE and age.seen == OK_STATE:
            self._note(self.faults.on_good(age.check, now_ns))
            return
        bad = age.state if age.state != OK_STATE else age.seen
        freeze = f"age {age.age_s(now_ns):.2f} s at {age.rate_hz:g} Hz"
        self._settle(Seen(age.check, age.state, AGE_LEVELS[bad], freeze), age.seen, now_ns)

    def on_value(self, rule: LimitRule, value: float, now_ns: int) -> None:
        """The newest value of a field with limits."""
        rule.on_value(value, now_ns)
        state = rule.state if rule.state != OK_STATE else rule.seen
        freeze = f"{rule.field} {value:g}"
        self._settle(Seen(rule.check, rule.state, default_level(state), freeze), rule.seen, now_ns)

    # -- checks of modules

    def register(self, registration: CheckRegistration, now_ns: int) -> bool:
        """True when the journal has to be written."""
        if registration.withdrawn:
            return self.withdraw(registration.check, now_ns)
        self.faults.clear_after(registration.check, registration.clear_s)
        return self.reports.register(registration, now_ns)

    def withdraw(self, check: str, now_ns: int) -> bool:
        """A module takes its check back."""
        self._note(self.faults.forget(check, now_ns))
        return self.reports.withdraw(check)

    def on_reports(self, reports: CheckReports, now_ns: int) -> None:
        """What an application says about its checks."""
        for report in reports.reports:
            known = self.reports.on_report(reports.app, report, now_ns)
            if known is not None:
                self._settle_report(known, now_ns)

    def _settle_report(self, known: Reported, now_ns: int) -> None:
        state = known.state if known.state != OK_STATE else known.seen or OK_STATE
        seen = Seen(
            known.registration.check,
            known.state,
            known.level(state),
            known.freeze,
            known.registration.description,
        )
        self._settle(seen, known.seen, now_ns)

    # -- all together

    def _settle(self, result: Seen, seen: str, now_ns: int) -> None:
        """`result.state` is believed, `seen` the state of the last look when it is another."""
        if result.state != OK_STATE and result.level != "ok":
            self._note(self.faults.on_bad(result, now_ns, believed=True))
        elif seen not in {OK_STATE, ""} and result.level != "ok":
            pending = msgspec.structs.replace(result, state=seen)
            self._note(self.faults.on_bad(pending, now_ns, believed=False))
        else:
            self._note(self.faults.on_good(result.check, now_ns))

    def _note(self, fault: Fault | None) -> None:
        if fault is not None:
            self._changed.append(fault)

    def on_timer(self, now_ns: int) -> None:
        """Checks that have fallen silent, faults that have stayed away."""
        for known in self.reports.silent(now_ns):
            self._settle_report(known, now_ns)
        for fault in self.faults.on_timer(now_ns):
            self._note(fault)

    def state(self) -> HealthState:
        """The logical state of the platform."""
        confirmed = self.faults.confirmed()
        alive, failed = self.apps.count()
        level: Level = confirmed[0].level if confirmed else "ok"
        battery, ratio = self._battery()
        return HealthState(
            level=level,
            battery=battery,
            battery_ratio=ratio,
            sensors=self._validity(confirmed),
            faults=tuple(f"{fault.check}={fault.state}" for fault in confirmed[:FAULTS_LIMIT]),
            fault_count=len(confirmed),
            checks=len(self._ages) + len(self._rules) + len(self.reports),
            apps_alive=alive,
            apps_failed=failed,
            guard=self.guard,
        )

    def _is_sensor(self, path: str) -> bool:
        return any(pattern.matches(path) for pattern in self._sensors)

    def _validity(self, confirmed: list[Fault]) -> dict[str, bool]:
        doubted = {self._rules[fault.check].path for fault in confirmed if fault.check in self._rules}
        paths = set(self._expected) | {path for path in self._ages if self._is_sensor(path)}
        return {
            path: (age := self._ages.get(path)) is not None and age.fresh and path not in doubted
            for path in sorted(paths)
        }

    def _battery(self) -> tuple[Literal["unknown", "ok", "low", "critical"], float]:
        age = self._ages.get(BATTERY_PATH)
        rule = next((one for one in self._rules.values() if one.path == BATTERY_PATH), None)
        if rule is None or rule.value is None or (age is not None and not age.fresh):
            return "unknown", -1.0
        ratio = round(round(rule.value / BATTERY_STEP) * BATTERY_STEP, 2)
        level = default_level(rule.state)
        return ("ok" if level == "ok" else "low" if level == "warn" else "critical"), ratio

    def checks(self) -> tuple[CheckState, ...]:
        """Every check and its present result, worst first."""
        found = [
            CheckState(app.check, "health", app.state, APP_LEVELS[app.state], app.since_ns, 1.0)
            for app in self.apps
            if app.beats
        ]
        found += [
            CheckState(age.check, "health", age.state, AGE_LEVELS[age.state], age.since_ns, age.rate_hz)
            for age in self._ages.values()
        ]
        found += [
            CheckState(rule.check, "health", rule.state, default_level(rule.state), rule.since_ns, 1.0)
            for rule in self._rules.values()
        ]
        found += self.reports.public()
        return tuple(sorted(found, key=lambda check: (check.level == "ok", check.check)))
