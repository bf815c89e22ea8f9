"""The monitor: makes faults and one state of the platform of looks, values, reports and deaths."""

from typing import Final, Literal

import msgspec

from swarmd.health.config import Config
from swarmd.health.core.apps import APP_LEVELS, DIED, HUNG, App, Apps
from swarmd.health.core.faults import FaultBook, Seen
from swarmd.health.core.platforms import Platforms
from swarmd.health.core.reports import ReportBook, Reported
from swarmd.health.core.rules import AgeRule, LimitRule
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
    Phase,
    default_level,
)
from swarmware.types.system import AppStatus

FAULTS_LIMIT: Final = 16
"""Names of faults in the state that the whole swarm may read."""
AGE_PREFIX: Final = "age/"
PLATFORM_PREFIX: Final = "platform/"
BATTERY_PATH: Final = "power/battery"
BATTERY_STEP: Final = 0.05
"""The ratio is rounded to this: the state travels on change."""

GUARD: Final = "guard"
"""The application that starts all others, and the only one on which the monitor acts."""
VALUES_NS: Final = 1_000_000_000
"""How often values with limits are looked at."""
LATE_NS: Final = 1_000_000_000
"""A monitor that was kept from running for longer blames nobody for that time."""


class Look(msgspec.Struct, frozen=True):
    """See what there is to be seen, then call `on_looked`."""

    values: bool
    """Also at values with limits."""


class FaultChanged(msgspec.Struct, frozen=True):
    """Others should know of this; first it is written to the journal."""

    fault: Fault


class RegistrationChanged(msgspec.Struct, frozen=True):
    """A module has registered or withdrawn a check: it is written to the journal."""

    registration: CheckRegistration


class Cleared(msgspec.Struct, frozen=True):
    """What became of the faults that an operator has cleared."""

    faults: tuple[Fault, ...]


class GuardHung(msgspec.Struct, frozen=True):
    """The guard is there and does not beat."""

    pid: int


Action = Look | FaultChanged | RegistrationChanged | Cleared | GuardHung


class Present(msgspec.Struct, frozen=True):
    """An application as its file says it."""

    app_id: str
    name: str
    pid: int
    started_ns: int
    resources: tuple[Resource, ...] = ()


class MonitorCore:
    """Everything the monitor knows."""

    def __init__(self, config: Config) -> None:
        self.faults = FaultBook(config.clear_s)
        self.reports = ReportBook()
        self.apps = Apps(config.hung_s)
        self.platforms = Platforms()
        self._limits = config.limits
        self._sensors = [Pattern(text) for text in config.sensors]
        self._ignore = [Pattern(text) for text in config.ignore]
        self._grace_ns = round(config.grace_s * 1e9)
        self._period_ns = round(1e9 / config.look_hz)
        self._look_ns: int | None = None
        self._values_ns = 0
        self._ages: dict[str, AgeRule] = {}
        self._rules: dict[str, LimitRule] = {}
        self._expected: dict[str, Resource] = {}
        self._critical: set[str] = set()
        self._settled_ns: int | None = None
        """Until then faults of a former monitor wait for their checks."""
        self._actions: list[Action] = []

    def expect(self, resources: tuple[Resource, ...]) -> None:
        """What the template says the platform has: sensors that nobody provides are not valid."""
        self._expected = {resource.path: resource for resource in resources if self._is_sensor(resource.path)}
        self._critical = {resource.path for resource in resources if resource.critical}

    def _done(self) -> list[Action]:
        """What came of one event."""
        actions, self._actions = self._actions, []
        return actions

    def on_start(
        self, registrations: tuple[CheckRegistration, ...], faults: tuple[Fault, ...], now_ns: int
    ) -> list[Action]:
        """Goes on where a monitor that was killed had stopped."""
        self._look_ns = self._values_ns = (now_ns // self._period_ns + 1) * self._period_ns
        for registration in registrations:
            self.faults.clear_after(registration.check, registration.clear_s)
            self.reports.restore(registration, now_ns)
        self.faults.restore(faults, now_ns)
        for fault in faults:
            if fault.check.startswith(PLATFORM_PREFIX):
                self.platforms.lose(fault.check.removeprefix(PLATFORM_PREFIX))
            elif fault.state == DIED and fault.phase is Phase.CONFIRMED:
                self.apps.restore(fault.check, now_ns)
        self._settled_ns = now_ns + self._grace_ns
        return self._done()

    def on_clear(self, pattern: str, now_ns: int) -> list[Action]:
        """An operator has seen the faults that match: they are over, and what is gone for good is forgotten.

        A check that goes on and is still bad makes a new fault. `Cleared` has what the faults are after that.
        """
        wanted = Pattern(pattern)
        after: list[Fault] = []
        for fault in self.faults.open():
            if wanted.matches(fault.check):
                cleared = self.faults.forget(fault.check, now_ns)
                self._note(cleared)
                self._forget(fault.check, now_ns)
                # a pending one was announced to nobody, so nothing is left of it in the history
                after.append(cleared or msgspec.structs.replace(fault, phase=Phase.CLEARED))
        self._actions.append(Cleared(tuple(after)))
        return self._done()

    def _forget(self, check: str, now_ns: int) -> None:
        """The check itself, unless it is of somebody who lives."""
        if check.startswith(PLATFORM_PREFIX):
            self.platforms.forget(check.removeprefix(PLATFORM_PREFIX))
        for app in self.apps:
            if app.check == check and app.state == DIED:
                self.apps.remove(app.id)
                for path in app.resources:
                    self._unwatch(path, now_ns)
        if (owner := self.reports.owner(check)) is not None and self._is_gone(owner):
            self._withdraw(check, now_ns)
        if check.startswith(AGE_PREFIX):
            path = check.removeprefix(AGE_PREFIX)
            if not any(path in app.resources for app in self.apps if app.state != DIED):
                self._unwatch(path, now_ns)

    def _is_gone(self, app_id: str) -> bool:
        app = self.apps.get(app_id)
        return app is None or app.state == DIED

    def _has_check(self, check: str) -> bool:
        """Whether there is anything left that could say that the fault is over."""
        return (
            check in self.reports
            or check in self._rules
            or check.removeprefix(AGE_PREFIX) in self._ages
            or check.removeprefix(PLATFORM_PREFIX) in self.platforms
            or any(app.check == check for app in self.apps)
        )

    # -- other platforms

    def on_platforms(self, present: set[str], now_ns: int) -> list[Action]:
        """Who can be reached: one that was, and is not any more, is a fault."""
        for platform, lost_s in self.platforms.on_present(present, now_ns):
            check = f"{PLATFORM_PREFIX}{platform}"
            if lost_s is None:
                self._note(self.faults.on_good(check, now_ns))
            else:
                seen = Seen(check, "lost", "warn", f"no route for {lost_s:.1f} s")
                self._note(self.faults.on_bad(seen, now_ns, believed=True))
        return self._done()

    # -- applications and their resources

    def on_present(self, entry: Present, now_ns: int) -> list[Action]:
        """An application file is there; its resources are watched from now on."""
        app_id, resources = entry.app_id, entry.resources
        before = self.apps.get(app_id)
        was_dead = before is not None and before.state == DIED
        old_paths = set(before.resources) if before is not None else set()
        app = self.apps.on_present(
            app_id, entry.name, entry.pid, {one.path: one for one in resources}, now_ns
        )
        app.started_ns = entry.started_ns
        if was_dead:
            self._settle_app(app, now_ns)
        for path in old_paths - set(app.resources):
            self._unwatch(path, now_ns)
        for resource in resources:
            self._watch(resource, entry.started_ns + self._grace_ns)
        return self._done()

    def on_died(self, app_id: str, now_ns: int) -> list[Action]:
        """A process ended without goodbye: its resources are still expected."""
        app = self.apps.on_died(app_id, now_ns)
        if app is not None:
            self._settle_app(app, now_ns)
        return self._done()

    def on_left(self, app_id: str, now_ns: int) -> list[Action]:
        """An application said goodbye: nothing of it is missed."""
        app = self.apps.on_left(app_id)
        if app is None:
            return []
        self._note(self.faults.forget(app.check, now_ns))
        for path in app.resources:
            self._unwatch(path, now_ns)
        for check in self.reports.of(app_id):
            self._withdraw(check, now_ns)
        return self._done()

    def on_status(self, app: App, status: AppStatus, now_ns: int) -> list[Action]:
        """The beat of an application."""
        if self.apps.on_status(app, status, now_ns):
            self._settle_app(app, now_ns)
            if app.name == GUARD and app.state == HUNG:
                self._actions.append(GuardHung(app.pid))
        return self._done()

    def _settle_app(self, app: App, now_ns: int) -> None:
        self._settle(
            Seen(app.check, app.state, APP_LEVELS[app.state], f"pid {app.pid}, beat {app.beat}"), "", now_ns
        )

    def _watch(self, resource: Resource, grace_until_ns: int) -> None:
        path = resource.path
        if any(pattern.matches(path) for pattern in self._ignore):
            return
        if path not in self._ages and AgeRule.applies(resource):
            critical = resource.critical or path in self._critical
            self._ages[path] = AgeRule(resource, grace_until_ns, critical=critical)
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

    def on_look(self, age: AgeRule, position: int, now_ns: int) -> list[Action]:
        """Where the ring of a resource stands."""
        age.on_look(position, now_ns)
        if age.in_grace(now_ns):
            return []
        if age.state == OK_STATE and age.seen == OK_STATE:
            self._note(self.faults.on_good(age.check, now_ns))
            return self._done()
        bad = age.state if age.state != OK_STATE else age.seen
        freeze = f"age {age.age_s(now_ns):.2f} s at {age.rate_hz:g} Hz"
        self._settle(Seen(age.check, age.state, age.level(bad), freeze), age.seen, now_ns)
        return self._done()

    def on_value(self, rule: LimitRule, value: float, now_ns: int) -> list[Action]:
        """The newest value of a field with limits."""
        rule.on_value(value, now_ns)
        state = rule.state if rule.state != OK_STATE else rule.seen
        freeze = f"{rule.field} {value:g}"
        self._settle(Seen(rule.check, rule.state, default_level(state), freeze), rule.seen, now_ns)
        return self._done()

    # -- checks of modules

    def on_registration(self, registration: CheckRegistration, now_ns: int) -> list[Action]:
        """A module registers a check, registers it again, or takes it back."""
        if self._register(registration, now_ns):
            self._actions.append(RegistrationChanged(registration))
        return self._done()

    def _register(self, registration: CheckRegistration, now_ns: int) -> bool:
        if registration.withdrawn:
            return self._withdraw(registration.check, now_ns)
        self.faults.clear_after(registration.check, registration.clear_s)
        return self.reports.register(registration, now_ns)

    def _withdraw(self, check: str, now_ns: int) -> bool:
        self._note(self.faults.forget(check, now_ns))
        return self.reports.withdraw(check)

    def on_reports(self, reports: CheckReports, now_ns: int) -> list[Action]:
        """What an application says about its checks."""
        for report in reports.reports:
            known = self.reports.on_report(reports.app, report, now_ns)
            if known is not None:
                self._settle_report(known, now_ns)
        return self._done()

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
            self._actions.append(FaultChanged(fault))

    def on_timer(self, now_ns: int) -> list[Action]:
        """It is time to look; when the monitor itself was kept from running, nobody else is to blame."""
        due_ns = now_ns if self._look_ns is None else self._look_ns
        if now_ns - due_ns > LATE_NS:
            self.apps.excuse(now_ns - due_ns)
        self._look_ns = (now_ns // self._period_ns + 1) * self._period_ns
        values = now_ns >= self._values_ns
        if values:
            self._values_ns = now_ns + VALUES_NS
        return [Look(values)]

    def deadline_ns(self) -> int | None:
        """When to look next: nothing is judged by what was not read."""
        return self._look_ns

    def on_looked(self, now_ns: int) -> list[Action]:
        """Checks that have fallen silent, faults that have stayed away."""
        for known in self.reports.silent(now_ns):
            app = self.apps.get(known.registration.app)
            if app is not None and app.state != DIED and known.stamp_ns < app.started_ns:
                # of a former life of the application, which has not registered it again
                self._withdraw(known.registration.check, now_ns)
            else:
                self._settle_report(known, now_ns)
        if self._settled_ns is not None and now_ns >= self._settled_ns:
            self._settled_ns = None
            for fault in self.faults.open():
                if not self._has_check(fault.check):
                    self._note(self.faults.forget(fault.check, now_ns))
        for fault in self.faults.on_timer(now_ns):
            self._note(fault)
        return self._done()

    def _guard(self) -> Literal["alive", "hung", "absent"]:
        guard = next((app for app in self.apps if app.name == GUARD and app.state != DIED), None)
        if guard is None:
            return "absent"
        return "hung" if guard.state == HUNG else "alive"

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
            guard=self._guard(),
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
            CheckState(age.check, "health", age.state, age.level(age.state), age.since_ns, age.rate_hz)
            for age in self._ages.values()
        ]
        found += [
            CheckState(rule.check, "health", rule.state, default_level(rule.state), rule.since_ns, 1.0)
            for rule in self._rules.values()
        ]
        found += self.reports.public()
        return tuple(sorted(found, key=lambda check: (check.level == "ok", check.check)))
