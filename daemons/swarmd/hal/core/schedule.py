"""Schedule of a driver with absolute instants, and statistics of lateness and rate."""

from typing import Final

from swarmware.types.driver import DriverState, DriverStatus
from swarmware.types.health import Level

_NS: Final = 1_000_000_000
_HUNG_NS: Final = 2 * _NS
"""Time without a call after which the status reports that the device does not answer."""
_LASTING_NS: Final = 3 * _NS
"""Duration of a fail-safe above which it is an error, as for the age of a resource."""


class Schedule:
    """Instants at which a driver reads, and statistics of its timing.

    A read that is longer than the period skips periods, which are counted and not caught up.
    `phase_ns`: offset of the instants from the multiples of the period.
    """

    __slots__ = (
        "_actuator",
        "_due_ns",
        "_errors",
        "_failed_in_a_row",
        "_first",
        "_lates_ns",
        "_missed",
        "_name",
        "_note",
        "_period_ns",
        "_phase_ns",
        "_reads",
        "_safe_level",
        "_safe_since_ns",
        "_since_ns",
        "_since_reads",
        "_stalled",
        "state",
    )

    def __init__(
        self, name: str, period_s: float, now_ns: int, phase_ns: int = 0, *, actuator: bool = False
    ) -> None:
        self._name = name
        self._actuator = actuator
        self._phase_ns = phase_ns
        self._period_ns = round(period_s * _NS)
        self._due_ns = now_ns
        self._since_ns = now_ns
        self._reads = self._since_reads = self._errors = self._missed = 0
        self._lates_ns: list[int] = []
        """Lateness of the calls since the last report."""
        self._failed_in_a_row = 0
        self._first = False
        self.state = DriverState.WAITING
        """Present state of the driver."""
        self._note = self._stalled = ""
        self._safe_level: Level = "ok"
        self._safe_since_ns = 0

    def opened(self, now_ns: int) -> None:
        """Takes that the device is open; the first read is due at once, further reads at multiples of the
        period.

        Reads of several devices thus coincide, and the process wakes less often.
        """
        self.state, self._note, self._due_ns, self._first = DriverState.RUNNING, "", now_ns, True
        self._failed_in_a_row = 0

    def closed(self, state: DriverState, note: str) -> None:
        """Takes that the device is closed, in the state `waiting` or `failed`, with the reason."""
        self.state, self._note = state, note

    def safe(self, reason: str, now_ns: int) -> Level | None:
        """Takes the reason of an actuator's fail-safe, or ""; returns the level of its check if it changed.

        A short fail-safe is a warning, because a restarted service or an overloaded processor recovers before
        the mission must be aborted.
        """
        if bool(reason) != (self.state is DriverState.FAILSAFE):
            self.state = DriverState.FAILSAFE if reason else DriverState.RUNNING
            self._note, self._safe_since_ns = reason, now_ns
        lasts = now_ns - self._safe_since_ns >= _LASTING_NS
        level: Level = "ok" if not reason else "error" if lasts else "warn"
        if level == self._safe_level:
            return None
        self._safe_level = level
        return level

    def stalled(self, reason: str) -> bool:
        """Takes why an answering sensor has no measurements, or ""; returns True if the reason changed."""
        if reason == self._stalled:
            return False
        self._stalled = self._note = reason
        return True

    @property
    def due_ns(self) -> int:
        """Instant of the next read."""
        return self._due_ns

    def begin(self, now_ns: int) -> None:
        """Takes the begin of a read, and schedules the next read."""
        late_ns = now_ns - self._due_ns
        self._lates_ns.append(late_ns)
        # skipped periods are counted, not caught up: a burst of reads would return the same values
        skipped = max(0, late_ns // self._period_ns)
        self._missed += skipped
        self._due_ns += (skipped + 1) * self._period_ns
        if self._first:
            self._first = False
            # from the second read on at multiples of the period
            self._due_ns -= (self._due_ns - self._phase_ns) % self._period_ns
            if self._due_ns <= now_ns:
                self._due_ns += self._period_ns

    def retime(self, period_s: float) -> None:
        """Changes the period; the next read is at a multiple of the new period."""
        period_ns = round(period_s * _NS)
        if period_ns != self._period_ns:
            before_ns = self._due_ns - self._period_ns
            self._period_ns = period_ns
            self._due_ns = before_ns + period_ns - (before_ns - self._phase_ns) % period_ns

    def done(self) -> None:
        """Takes a read that returned new values."""
        self._reads += 1
        self._failed_in_a_row = 0

    def failed(self, note: str) -> int:
        """Takes a failed read; returns the number of consecutive failures."""
        self._errors += 1
        self._failed_in_a_row += 1
        self._note = note
        return self._failed_in_a_row

    def report(self, now_ns: int) -> DriverStatus:
        """Statistics since the last report, which start again."""
        span_s = max((now_ns - self._since_ns) / _NS, 1e-9)
        lates_ns = sorted(self._lates_ns)
        overdue_ns = now_ns - self._due_ns
        # a device that blocks its thread raises no error; the missing call shows it
        hung = self.state is DriverState.RUNNING and overdue_ns > max(_HUNG_NS, self._period_ns)
        status = DriverStatus(
            self._name,
            self.state,
            round(_NS / self._period_ns, 3),
            round((self._reads - self._since_reads) / span_s, 2),
            round(lates_ns[-1] / 1e6, 3) if lates_ns else 0.0,
            self._reads,
            self._errors,
            self._missed,
            f"the device has not answered for {overdue_ns / 1e9:.0f} s" if hung else self._note,
            self._actuator,
            round(lates_ns[int(0.99 * (len(lates_ns) - 1))] / 1e6, 3) if lates_ns else 0.0,
        )
        self._since_ns, self._since_reads = now_ns, self._reads
        self._lates_ns.clear()
        return status
