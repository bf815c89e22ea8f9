"""Checks that modules run themselves: what they registered, and what they report."""

from typing import Final, Literal

import msgspec

from swarmware.types.health import OK_STATE, CheckRegistration, CheckReport, CheckState, Level, default_level

SILENT: Final = "silent"
REPORT_S: Final = 1.0
"""Modules repeat their reports so often."""
SILENT_PERIODS: Final = 3.0


class Reported(msgspec.Struct):
    """One registered check and its newest report."""

    registration: CheckRegistration
    heard_ns: int
    """When it was registered, or its last report was found."""
    since_ns: int
    state: str = OK_STATE
    seen: str = ""
    freeze: str = ""
    stamp_ns: int = 0
    """Newest sign of life of who runs it: a registration or a report; 0: only the journal knows it."""
    stated: Level | Literal[""] = ""
    """Level that the newest report gives with its state."""

    @property
    def silent_ns(self) -> int:
        """Without a report for so long it is silent."""
        period_s = max(REPORT_S, 1 / self.registration.frequency_hz)
        return round(SILENT_PERIODS * period_s * 1e9)

    def level(self, state: str) -> Level:
        """How bad a state is, as the registration says."""
        if state == SILENT:
            return "warn"
        if self.stated and state == self.state:
            return self.stated
        for rule in self.registration.states:
            if rule.state == state:
                return rule.level
        return default_level(state)

    def public(self) -> CheckState:
        """What others see."""
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


class ReportBook:
    """All checks of modules."""

    def __init__(self) -> None:
        self._checks: dict[str, Reported] = {}

    def __contains__(self, check: str) -> bool:
        return check in self._checks

    def __len__(self) -> int:
        return len(self._checks)

    def restore(self, registration: CheckRegistration, now_ns: int) -> None:
        """A check of the journal: who ran it may have ended since."""
        self._checks[registration.check] = Reported(registration, now_ns, now_ns)

    def register(self, registration: CheckRegistration, now_ns: int) -> bool:
        """A new check, or the same again; True when the journal has to be written."""
        known = self._checks.get(registration.check)
        if known is None:
            self._checks[registration.check] = Reported(registration, now_ns, now_ns, stamp_ns=now_ns)
            return True
        known.heard_ns = known.stamp_ns = now_ns
        if known.registration == registration:
            return False
        known.registration = registration
        return True

    def withdraw(self, check: str) -> bool:
        """The module takes it back, or has ended; False when it was not known."""
        return self._checks.pop(check, None) is not None

    def owner(self, check: str) -> str | None:
        """The application that runs a check."""
        known = self._checks.get(check)
        return None if known is None else known.registration.app

    def of(self, app: str) -> list[str]:
        """Checks of one application."""
        return [check for check, known in self._checks.items() if known.registration.app == app]

    def on_report(self, app: str, report: CheckReport, now_ns: int) -> Reported | None:
        """The newest report; None when the check is not registered, or is another application's."""
        known = self._checks.get(report.check)
        if known is None or known.registration.app != app:
            return None
        known.heard_ns = now_ns
        known.stamp_ns = report.stamp_ns
        known.seen, known.freeze, known.stated = report.seen, report.freeze, report.level
        if known.state != report.state:
            known.state = report.state
            known.since_ns = now_ns
        return known

    def silent(self, now_ns: int) -> list[Reported]:
        """Checks without a report for three periods that were not known to be silent."""
        found = []
        for known in self._checks.values():
            if known.state != SILENT and now_ns - known.heard_ns >= known.silent_ns:
                known.state = SILENT
                known.since_ns = now_ns
                known.freeze = f"no report for {(now_ns - known.heard_ns) / 1e9:.1f} s"
                found.append(known)
        return found

    def registrations(self) -> tuple[CheckRegistration, ...]:
        """For the journal."""
        return tuple(known.registration for known in self._checks.values())

    def public(self) -> list[CheckState]:
        """What others see."""
        return [known.public() for known in self._checks.values()]
