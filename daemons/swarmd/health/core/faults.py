"""Faults with their phases pending, confirmed, healed and cleared.

Source: AUTOSAR Classic Platform, Diagnostic Event Manager.
"""

from collections import deque
from enum import StrEnum
from typing import Final

import msgspec

from swarmware.types.health import WORSE, Fault, Level, Phase

HISTORY: Final = 64
"""Number of cleared faults that are kept for requests."""


class FaultEvent(StrEnum):
    """Event of a fault, made from samples of its check."""

    PREFAILED = "prefailed"
    """A sample failed, and the failure is not confirmed."""
    FAILED = "failed"
    """The failure is confirmed."""
    PASSED = "passed"
    """A sample of the check passed."""
    EXPIRED = "expired"
    """The check passed for the whole clear time."""


TRANSITIONS: Final[dict[tuple[Phase, FaultEvent], Phase]] = {
    (Phase.CLEARED, FaultEvent.PREFAILED): Phase.PENDING,
    (Phase.CLEARED, FaultEvent.FAILED): Phase.CONFIRMED,
    (Phase.PENDING, FaultEvent.PREFAILED): Phase.PENDING,
    (Phase.PENDING, FaultEvent.FAILED): Phase.CONFIRMED,
    (Phase.PENDING, FaultEvent.PASSED): Phase.CLEARED,
    (Phase.CONFIRMED, FaultEvent.PREFAILED): Phase.CONFIRMED,
    (Phase.CONFIRMED, FaultEvent.FAILED): Phase.CONFIRMED,
    (Phase.CONFIRMED, FaultEvent.PASSED): Phase.HEALED,
    (Phase.HEALED, FaultEvent.PREFAILED): Phase.HEALED,
    (Phase.HEALED, FaultEvent.FAILED): Phase.CONFIRMED,
    (Phase.HEALED, FaultEvent.PASSED): Phase.HEALED,
    (Phase.HEALED, FaultEvent.EXPIRED): Phase.CLEARED,
}


class CheckSample(msgspec.Struct, frozen=True):
    """One sample of a check that failed."""

    check: str
    state: str
    level: Level
    freeze_frame: str = ""
    message: str = ""


class FaultTable:
    """One fault for each check, with its phase; cleared faults move to the history."""

    def __init__(self, clear_s: float) -> None:
        self._clear_ns = round(clear_s * 1e9)
        self._open: dict[str, Fault] = {}
        self._clear_at_ns: dict[str, int] = {}
        self._clear_ns_by_check: dict[str, int] = {}
        self._history: deque[Fault] = deque(maxlen=HISTORY)

    def restore(self, faults: tuple[Fault, ...], now_ns: int) -> None:
        """Restores the faults of the previous, killed monitor."""
        for fault in faults:
            self._open[fault.check] = fault
            if fault.phase is Phase.HEALED:
                # the clear time begins again, as the passes before the kill are not known
                self._clear_at_ns[fault.check] = now_ns + self._clear_ns

    def set_clear_time(self, check: str, clear_s: float) -> None:
        """Sets the time for which this check must pass before its fault is cleared."""
        self._clear_ns_by_check[check] = round(clear_s * 1e9)

    def on_failed(self, sample: CheckSample, now_ns: int, *, confirmed: bool) -> Fault | None:
        """Takes a failed sample; returns the fault if it changed and is to be published."""
        event = FaultEvent.FAILED if confirmed else FaultEvent.PREFAILED
        old = self._open.get(sample.check)
        phase = TRANSITIONS[old.phase if old else Phase.CLEARED, event]
        if old is None:
            count = 1 if phase is Phase.CONFIRMED else 0
            new = Fault(
                sample.check,
                sample.state,
                sample.level,
                phase,
                now_ns,
                now_ns,
                count,
                sample.freeze_frame,
                sample.message,
            )
        else:
            newly_confirmed = phase is Phase.CONFIRMED and old.phase is not Phase.CONFIRMED
            new = msgspec.structs.replace(old, phase=phase, last_ns=now_ns, count=old.count + newly_confirmed)
            if confirmed:
                new = msgspec.structs.replace(
                    new, state=sample.state, level=sample.level, message=sample.message
                )
            # the freeze frame shows the sample that confirmed the fault; a healed fault keeps its first one
            if newly_confirmed and old.phase is Phase.PENDING:
                new = msgspec.structs.replace(new, freeze=sample.freeze_frame)
        self._open[sample.check] = new
        if phase is not Phase.HEALED:
            # the clear time starts again at the next pass
            self._clear_at_ns.pop(sample.check, None)
        # repeated samples of an unchanged fault are not published
        known = old is not None and (old.phase, old.state, old.level) == (new.phase, new.state, new.level)
        return None if known or phase is Phase.PENDING else new

    def on_passed(self, check: str, now_ns: int) -> Fault | None:
        """Takes a passed sample; returns the fault if it changed and is to be published."""
        old = self._open.get(check)
        if old is None:
            return None
        phase = TRANSITIONS[old.phase, FaultEvent.PASSED]
        if phase is old.phase:
            return None
        if phase is Phase.CLEARED:
            del self._open[check]  # never confirmed, so never announced
            return None
        healed = msgspec.structs.replace(old, phase=phase)
        self._open[check] = healed
        self._clear_at_ns[check] = now_ns + self._clear_ns_by_check.get(check, self._clear_ns)
        return healed

    def withdraw(self, check: str, now_ns: int) -> Fault | None:
        """Clears the fault of a withdrawn check; returns the fault if it is to be published."""
        self._clear_ns_by_check.pop(check, None)
        healed = self.on_passed(check, now_ns)
        # at once: without its check nothing can pass or fail any more
        return self._clear(check) if check in self._open else healed

    def advance(self, now_ns: int) -> list[Fault]:
        """Clears the faults whose clear time is over, and returns them."""
        due = [check for check, at_ns in self._clear_at_ns.items() if at_ns <= now_ns]
        return [self._clear(check) for check in due]

    def _clear(self, check: str) -> Fault:
        old = self._open.pop(check)
        self._clear_at_ns.pop(check, None)
        cleared = msgspec.structs.replace(old, phase=TRANSITIONS[old.phase, FaultEvent.EXPIRED])
        self._history.append(cleared)
        return cleared

    def confirmed(self) -> list[Fault]:
        """Confirmed faults, the worst level first, then the oldest first."""
        found = [fault for fault in self._open.values() if fault.phase is Phase.CONFIRMED]
        return sorted(found, key=lambda fault: (-WORSE[fault.level], fault.first_ns))

    def open(self) -> tuple[Fault, ...]:
        """Faults that are not cleared, the newest first."""
        return tuple(sorted(self._open.values(), key=lambda fault: -fault.last_ns))

    def cleared(self) -> tuple[Fault, ...]:
        """Cleared faults, the newest first."""
        return tuple(reversed(self._history))
