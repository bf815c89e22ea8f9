"""Registrations and reports of the checks that modules run themselves."""

from typing import Final, Literal

import msgspec

from swarmware.types.health import OK_STATE, CheckRegistration, CheckReport, CheckState, Level, default_level

SILENT: Final = "silent"
REPORT_S: Final = 1.0
"""Period in which modules repeat their reports."""
SILENT_PERIODS: Final = 3.0


class RegisteredCheck(msgspec.Struct):
    """One registered check and its newest report."""

    registration: CheckRegistration
    updated_ns: int
    """Instant of the registration, or of the reading of the newest report."""
    since_ns: int
    state: str = OK_STATE
    raw: str = ""
    freeze_frame: str = ""
    stamp_ns: int = 0
    """Stamp of the module's newest registration or report, or 0 for a registration from the journal."""
    reported_level: Level | Literal[""] = ""
    """Level that the newest report states, or "" without one."""

    @property
    def silent_ns(self) -> int:
        """Time without a report after which the check is silent."""
        # modules repeat their reports once per REPORT_S, even if the check runs more often
        period_s = max(REPORT_S, 1 / self.registration.frequency_hz)
        return round(SILENT_PERIODS * period_s * 1e9)

    def level(self, state: str) -> Level:
        """Level of a state, as reported or registered."""
        if state == SILENT:
            return "warn"
        # the report's own level applies to the reported state only
        if self.reported_level and state == self.state:
            return self.reported_level
        for rule in self.registration.states:
            if rule.state == state:
                return rule.level
        return default_level(state)

    def check_state(self) -> CheckState:
        """State for the list of checks."""
        one = self.registration
        return CheckState(
            one.check,
            one.app,
            self.state,
            self.level(self.state),
            self.since_ns,
            one.frequency_hz,
            one.description,
        )


class RegisteredChecks:
    """All checks that modules have registered, with their newest reports."""

    def __init__(self) -> None:
        self._checks: dict[str, RegisteredCheck] = {}

    def __contains__(self, check: str) -> bool:
        return check in self._checks

    def __len__(self) -> int:
        return len(self._checks)

    def restore(self, registration: CheckRegistration, now_ns: int) -> None:
        """Restores a check from the journal, although its module may have ended since."""
        self._checks[registration.check] = RegisteredCheck(registration, now_ns, now_ns)

    def register(self, registration: CheckRegistration, now_ns: int) -> bool:
        """Adds or renews a check; returns True if the journal must be written."""
        known = self._checks.get(registration.check)
        if known is None:
            self._checks[registration.check] = RegisteredCheck(registration, now_ns, now_ns, stamp_ns=now_ns)
            return True
        known.updated_ns = known.stamp_ns = now_ns
        if known.registration == registration:
            return False
        known.registration = registration
        return True

    def withdraw(self, check: str) -> bool:
        """Removes a check that was withdrawn, or whose module has ended; returns False if it is unknown."""
        return self._checks.pop(check, None) is not None

    def owner(self, check: str) -> str | None:
        """Application that runs a check, or None if the check is unknown."""
        known = self._checks.get(check)
        return None if known is None else known.registration.app

    def of(self, app: str) -> list[str]:
        """Names of the checks of one application."""
        return [check for check, known in self._checks.items() if known.registration.app == app]

    def on_report(self, app: str, report: CheckReport, now_ns: int) -> RegisteredCheck | None:
        """Stores a report; returns its check, or None if this application has not registered the check."""
        known = self._checks.get(report.check)
        # a module must not report on the checks of another one
        if known is None or known.registration.app != app:
            return None
        known.updated_ns = now_ns
        known.stamp_ns = report.stamp_ns
        known.raw, known.freeze_frame, known.reported_level = report.seen, report.freeze, report.level
        if known.state != report.state:
            known.state = report.state
            known.since_ns = now_ns
        return known

    def silent(self, now_ns: int) -> list[RegisteredCheck]:
        """Returns the checks that became silent, which are three periods without a report."""
        found = []
        for known in self._checks.values():
            if known.state != SILENT and now_ns - known.updated_ns >= known.silent_ns:
                known.state = SILENT
                known.since_ns = now_ns
                known.freeze_frame = f"no report for {(now_ns - known.updated_ns) / 1e9:.1f} s"
                found.append(known)
        return found

    def registrations(self) -> tuple[CheckRegistration, ...]:
        """All registrations, for the journal."""
        return tuple(known.registration for known in self._checks.values())

    def check_states(self) -> list[CheckState]:
        """State for the list of checks."""
        return [known.check_state() for known in self._checks.values()]
