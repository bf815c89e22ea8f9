"""A condition of a module that it states itself, when something happens: no data has to be asked for."""

from swarmware.types.health import OK_STATE, CheckRegistration, CheckReport, Level


class Condition:
    """The newest statement about one thing; repeated to the monitor like the result of a check."""

    def __init__(self, registration: CheckRegistration, now_ns: int) -> None:
        self.registration = registration
        self._state = OK_STATE
        self._level: Level = "ok"
        self._detail = ""
        self._stamp_ns = now_ns

    def set(self, state: str, level: Level, detail: str, now_ns: int) -> bool:
        """True when the state or its level is another; a new detail waits for the next report."""
        self._stamp_ns = now_ns
        self._detail = detail
        before = (self._state, self._level)
        self._state, self._level = state, level
        return before != (state, level)

    def report(self) -> CheckReport:
        """For the monitor."""
        return CheckReport(
            self.registration.check, self._state, self._stamp_ns, freeze=self._detail, level=self._level
        )
