"""The monitor: derives faults and the state of the platform from samples, reports and process exits."""

from collections.abc import Callable
from functools import lru_cache
from typing import Final, Literal

import msgspec

from swarmd.health.config import Config
from swarmd.health.core.apps import APP_LEVELS, DIED, HUNG, WatchedApp, WatchedApps
from swarmd.health.core.faults import CheckSample, FaultTable
from swarmd.health.core.platforms import PlatformPresence
from swarmd.health.core.reports import RegisteredCheck, RegisteredChecks
from swarmd.health.core.rules import AgeRule, LimitRule
from swarmware.model.names import Pattern
from swarmware.model.resource import Resource
from swarmware.runtime.loop_delay import LoopDelay
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
"""Maximum number of faults that the published state names."""
AGE_PREFIX: Final = "age/"
PLATFORM_PREFIX: Final = "platform/"
BATTERY_PATH: Final = "power/battery"
BATTERY_STEP: Final = 0.05
"""Step to which the ratio is rounded, because each change of the state is published."""

GUARD: Final = "guard"
"""Name of the application that starts all others, and the only one on which the monitor acts."""
VALUES_NS: Final = 1_000_000_000
"""Period of sampling values with limits."""


class ReadInputs(msgspec.Struct, frozen=True):
    """Action: read positions, status boards, reports and routes, call their events, then `on_inputs_read`."""

    values: bool
    """True if the values with limits are to be read as well."""


class FaultChanged(msgspec.Struct, frozen=True):
    """Action: write the change of a fault to the journal, then announce it."""

    fault: Fault


class RegistrationChanged(msgspec.Struct, frozen=True):
    """Action: write to the journal that a module has registered or withdrawn a check."""

    registration: CheckRegistration


class FaultsCleared(msgspec.Struct, frozen=True):
    """Action: report the faults that an operator has cleared, in their phase after that."""

    faults: tuple[Fault, ...]


class GuardHung(msgspec.Struct, frozen=True):
    """Action: kill the guard, which runs without a heartbeat."""

    pid: int


Action = ReadInputs | FaultChanged | RegistrationChanged | FaultsCleared | GuardHung


class RunningApp(msgspec.Struct, frozen=True):
    """An application as described by its application file."""

    app_id: str
    name: str
    pid: int
    started_ns: int
    resources: tuple[Resource, ...] = ()


class MonitorCore:
    """Derives faults and the state of the platform."""

    def __init__(self, config: Config) -> None:
        self.faults = FaultTable(config.clear_s)
        self.reports = RegisteredChecks()
        self.apps = WatchedApps(config.hung_s)
        self.platforms = PlatformPresence()
        self._limits = config.limits
        sensors = [Pattern(text) for text in config.sensors]
        # four times a second for each monitored resource
        self._is_sensor: Callable[[str], bool] = lru_cache(maxsize=1024)(
            lambda path: any(pattern.matches(path) for pattern in sensors)
        )
        self._ignore = [Pattern(text) for text in config.ignore]
        self._grace_ns = round(config.grace_s * 1e9)
        self._period_ns = round(1e9 / config.look_hz)
        self._next_read_ns: int | None = None
        self._delay = LoopDelay()
        self._next_values_ns = 0
        self._ages: dict[str, AgeRule] = {}
        self._rules: dict[str, LimitRule] = {}
        self._expected: dict[str, Resource] = {}
        self._critical: set[str] = set()
        self._restored_until_ns: int | None = None
        """Instant until which faults of the previous monitor are kept without their checks."""
        self._actions: list[Action] = []

    def set_template(self, resources: tuple[Resource, ...]) -> None:
        """Sets the resources of the template, whose sensors are invalid until an application provides
        them."""
        self._expected = {resource.path: resource for resource in resources if self._is_sensor(resource.path)}
        self._critical = {resource.path for resource in resources if resource.critical}

    def _take_actions(self) -> list[Action]:
        """Returns the actions of the current event, and clears them."""
        actions, self._actions = self._actions, []
        return actions

    def on_start(
        self, registrations: tuple[CheckRegistration, ...], faults: tuple[Fault, ...], now_ns: int
    ) -> list[Action]:
        """Restores the journal of the previous, killed monitor."""
        self._next_read_ns = self._next_values_ns = (now_ns // self._period_ns + 1) * self._period_ns
        for registration in registrations:
            self.faults.set_clear_time(registration.check, registration.clear_s)
            self.reports.restore(registration, now_ns)
        self.faults.restore(faults, now_ns)
        for fault in faults:
            if fault.check.startswith(PLATFORM_PREFIX):
                self.platforms.restore_lost(fault.check.removeprefix(PLATFORM_PREFIX))
            elif fault.state == DIED and fault.phase is Phase.CONFIRMED:
                self.apps.restore(fault.check, now_ns)
        # modules need this time to register their checks again
        self._restored_until_ns = now_ns + self._grace_ns
        return self._take_actions()

    def on_clear(self, pattern: str, now_ns: int) -> list[Action]:
        """Clears the matching faults at an operator's request, and removes the checks of ended applications.

        A check that still fails makes a new fault.
        """
        wanted = Pattern(pattern)
        after: list[Fault] = []
        for fault in self.faults.open():
            if wanted.matches(fault.check):
                cleared = self.faults.withdraw(fault.check, now_ns)
                self._announce(cleared)
                self._forget(fault.check, now_ns)
                # a pending fault was never announced, so the history does not contain it
                after.append(cleared or msgspec.structs.replace(fault, phase=Phase.CLEARED))
        self._actions.append(FaultsCleared(tuple(after)))
        return self._take_actions()

    def _forget(self, check: str, now_ns: int) -> None:
        """Removes the check itself, unless its application is alive."""
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
        """True if a check of this name exists, so that its fault can heal."""
        return (
            check in self.reports
            or check in self._rules
            or check.removeprefix(AGE_PREFIX) in self._ages
            or check.removeprefix(PLATFORM_PREFIX) in self.platforms
            or any(app.check == check for app in self.apps)
        )

    # -- other platforms

    def on_platforms(self, reachable: set[str], now_ns: int) -> list[Action]:
        """Takes the reachable platforms; the loss of a platform is a fault."""
        for platform, lost_s in self.platforms.on_reachable(reachable, now_ns):
            check = f"{PLATFORM_PREFIX}{platform}"
            if lost_s is None:
                self._announce(self.faults.on_passed(check, now_ns))
            else:
                sample = CheckSample(check, "lost", "warn", f"no route for {lost_s:.1f} s")
                self._announce(self.faults.on_failed(sample, now_ns, confirmed=True))
        return self._take_actions()

    # -- applications and their resources

    def on_running(self, entry: RunningApp, now_ns: int) -> list[Action]:
        """Takes that an application has a file, and monitors its resources from now on."""
        app_id, resources = entry.app_id, entry.resources
        before = self.apps.get(app_id)
        was_dead = before is not None and before.state == DIED
        old_paths = set(before.resources) if before is not None else set()
        app = self.apps.on_running(
            app_id, entry.name, entry.pid, {one.path: one for one in resources}, now_ns
        )
        app.started_ns = entry.started_ns
        if was_dead:
            self._update_app_fault(app, now_ns)
        for path in old_paths - set(app.resources):
            self._unwatch(path, now_ns)
        for resource in resources:
            self._watch(resource, entry.started_ns + self._grace_ns)
        return self._take_actions()

    def on_died(self, app_id: str, now_ns: int) -> list[Action]:
        """Takes the death of an application, whose resources are still expected."""
        app = self.apps.on_died(app_id, now_ns)
        if app is not None:
            self._update_app_fault(app, now_ns)
        return self._take_actions()

    def on_left(self, app_id: str, now_ns: int) -> list[Action]:
        """Takes that an application left the node, and stops monitoring its resources."""
        app = self.apps.on_left(app_id)
        if app is None:
            return []
        self._announce(self.faults.withdraw(app.check, now_ns))
        for path in app.resources:
            self._unwatch(path, now_ns)
        for check in self.reports.of(app_id):
            self._withdraw(check, now_ns)
        return self._take_actions()

    def on_status(self, app: WatchedApp, status: AppStatus, now_ns: int) -> list[Action]:
        """Takes the status board of an application."""
        if self.apps.on_status(app, status, now_ns):
            self._update_app_fault(app, now_ns)
            # the guard restarts all others, and only the monitor watches the guard
            if app.name == GUARD and app.state == HUNG:
                self._actions.append(GuardHung(app.pid))
        return self._take_actions()

    def _update_app_fault(self, app: WatchedApp, now_ns: int) -> None:
        self._update_fault(
            CheckSample(app.check, app.state, APP_LEVELS[app.state], f"pid {app.pid}, beat {app.beat}"),
            "",
            now_ns,
        )

    def _watch(self, resource: Resource, grace_until_ns: int) -> None:
        path = resource.path
        if any(pattern.matches(path) for pattern in self._ignore):
            return
        # an existing rule keeps its state when an application file changes
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
            self._announce(self.faults.withdraw(age.check, now_ns))
        for rule in [rule for rule in self._rules.values() if rule.path == path]:
            del self._rules[rule.check]
            self._announce(self.faults.withdraw(rule.check, now_ns))

    # -- rules of the monitor

    def ages(self) -> list[AgeRule]:
        """Rules for the ages of resources."""
        return list(self._ages.values())

    def limits(self) -> list[LimitRule]:
        """Rules for the limits of values."""
        return list(self._rules.values())

    def on_age_sample(self, age: AgeRule, position: int, now_ns: int) -> list[Action]:
        """Takes a sample of the position of a resource's ring, which moves with each value."""
        age.on_sample(position, now_ns)
        # an application that has just started cannot have written yet
        if age.in_grace(now_ns):
            return []
        if age.state == OK_STATE and age.raw == OK_STATE:
            self._announce(self.faults.on_passed(age.check, now_ns))
            return self._take_actions()
        bad = age.state if age.state != OK_STATE else age.raw
        freeze = f"age {age.age_s(now_ns):.2f} s at {age.rate_hz:g} Hz"
        self._update_fault(CheckSample(age.check, age.state, age.level(bad), freeze), age.raw, now_ns)
        return self._take_actions()

    def on_value(self, rule: LimitRule, value: float, now_ns: int) -> list[Action]:
        """Takes a sample of a field with limits."""
        rule.on_value(value, now_ns)
        state = rule.state if rule.state != OK_STATE else rule.raw
        freeze = f"{rule.field} {value:g}"
        self._update_fault(
            CheckSample(rule.check, rule.state, default_level(state), freeze), rule.raw, now_ns
        )
        return self._take_actions()

    # -- checks of modules

    def on_registration(self, registration: CheckRegistration, now_ns: int) -> list[Action]:
        """Takes that a module registers, renews or withdraws a check."""
        if self._register(registration, now_ns):
            self._actions.append(RegistrationChanged(registration))
        return self._take_actions()

    def _register(self, registration: CheckRegistration, now_ns: int) -> bool:
        if registration.withdrawn:
            return self._withdraw(registration.check, now_ns)
        self.faults.set_clear_time(registration.check, registration.clear_s)
        return self.reports.register(registration, now_ns)

    def _withdraw(self, check: str, now_ns: int) -> bool:
        self._announce(self.faults.withdraw(check, now_ns))
        return self.reports.withdraw(check)

    def on_reports(self, reports: CheckReports, now_ns: int) -> list[Action]:
        """Takes the reports of an application on its checks."""
        for report in reports.reports:
            known = self.reports.on_report(reports.app, report, now_ns)
            if known is not None:
                self._update_report_fault(known, now_ns)
        return self._take_actions()

    def _update_report_fault(self, known: RegisteredCheck, now_ns: int) -> None:
        state = known.state if known.state != OK_STATE else known.raw or OK_STATE
        sample = CheckSample(
            known.registration.check,
            known.state,
            known.level(state),
            known.freeze_frame,
            known.registration.description,
        )
        self._update_fault(sample, known.raw, now_ns)

    # -- faults

    def _update_fault(self, sample: CheckSample, raw: str, now_ns: int) -> None:
        """Updates the fault of a check from its confirmed state and the state `raw` of the last sample."""
        if sample.state != OK_STATE and sample.level != "ok":
            self._announce(self.faults.on_failed(sample, now_ns, confirmed=True))
        elif raw not in {OK_STATE, ""} and sample.level != "ok":
            pending = msgspec.structs.replace(sample, state=raw)
            self._announce(self.faults.on_failed(pending, now_ns, confirmed=False))
        else:
            self._announce(self.faults.on_passed(sample.check, now_ns))

    def _announce(self, fault: Fault | None) -> None:
        if fault is not None:
            self._actions.append(FaultChanged(fault))

    def on_timer(self, now_ns: int) -> list[Action]:
        """Requests the inputs; a delay of the monitor itself extends ages and the time of heartbeats."""
        if late_ns := self._delay.on_turn(self._next_read_ns, now_ns):
            self.apps.extend_heartbeats(late_ns)
            for age in self._ages.values():
                age.extend(late_ns)
        # at multiples of the period, as other services: shared instants wake the computer less often
        self._next_read_ns = (now_ns // self._period_ns + 1) * self._period_ns
        values = now_ns >= self._next_values_ns
        if values:
            self._next_values_ns = now_ns + VALUES_NS
        return [ReadInputs(values)]

    def deadline_ns(self) -> int | None:
        """Instant of the next reading of inputs."""
        return self._next_read_ns

    def on_inputs_read(self, now_ns: int) -> list[Action]:
        """Evaluates silent checks and the clear times of faults, after all inputs were read."""
        for known in self.reports.silent(now_ns):
            app = self.apps.get(known.registration.app)
            if app is not None and app.state != DIED and known.stamp_ns < app.started_ns:
                # registered by a previous process of the application, and not by the present one
                self._withdraw(known.registration.check, now_ns)
            else:
                self._update_report_fault(known, now_ns)
        if self._restored_until_ns is not None and now_ns >= self._restored_until_ns:
            self._restored_until_ns = None
            for fault in self.faults.open():
                if not self._has_check(fault.check):
                    self._announce(self.faults.withdraw(fault.check, now_ns))
        for fault in self.faults.advance(now_ns):
            self._announce(fault)
        return self._take_actions()

    def _guard(self) -> Literal["alive", "hung", "absent"]:
        guard = next((app for app in self.apps if app.name == GUARD and app.state != DIED), None)
        if guard is None:
            return "absent"
        return "hung" if guard.state == HUNG else "alive"

    def state(self) -> HealthState:
        """Logical state of the platform, as it is published."""
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

    def _validity(self, confirmed: list[Fault]) -> dict[str, bool]:
        # a fresh value beyond its limits is not valid either
        suspect = {self._rules[fault.check].path for fault in confirmed if fault.check in self._rules}
        paths = set(self._expected) | {path for path in self._ages if self._is_sensor(path)}
        return {
            path: (age := self._ages.get(path)) is not None and age.fresh and path not in suspect
            for path in sorted(paths)
        }

    def _battery(self) -> tuple[Literal["unknown", "ok", "low", "critical"], float]:
        age = self._ages.get(BATTERY_PATH)
        rule = next((one for one in self._rules.values() if one.path == BATTERY_PATH), None)
        # an old charge could hide an empty battery
        if rule is None or rule.value is None or (age is not None and not age.fresh):
            return "unknown", -1.0
        ratio = round(round(rule.value / BATTERY_STEP) * BATTERY_STEP, 2)
        level = default_level(rule.state)
        return ("ok" if level == "ok" else "low" if level == "warn" else "critical"), ratio

    def checks(self) -> tuple[CheckState, ...]:
        """All checks with their states, failed checks first."""
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
        found += self.reports.check_states()
        return tuple(sorted(found, key=lambda check: (check.level == "ok", check.check)))
