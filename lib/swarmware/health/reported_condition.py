"""A condition that a module reports itself when something happens, without periodic sampling."""

from swarmware.types.health import OK_STATE, CheckRegistration, CheckReport, Level


class ReportedCondition:
    """The newest state of one condition; reported to the monitor like that of a check."""

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
