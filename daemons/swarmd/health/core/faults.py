"""Faults and their life: pending → confirmed → healed → cleared."""

from collections import deque
from enum import StrEnum
from typing import Final

import msgspec

from swarmware.types.health import WORSE, Fault, Level, Phase

HISTORY: Final = 64
"""Cleared faults that are still told of."""


class Event(StrEnum):
    """What a check says about its fault."""

    SEEN = "seen"
    """A look was bad, but is not believed yet."""
    BELIEVED = "believed"
    GONE = "gone"
    """Believed to be well."""
    EXPIRED = "expired"
    """It stayed away for long enough."""


TRANSITIONS: Final[dict[tuple[Phase, Event], Phase]] = {
    (Phase.CLEARED, Event.SEEN): Phase.PENDING,
    (Phase.CLEARED, Event.BELIEVED): Phase.CONFIRMED,
    (Phase.PENDING, Event.SEEN): Phase.PENDING,
    (Phase.PENDING, Event.BELIEVED): Phase.CONFIRMED,
    (Phase.PENDING, Event.GONE): Phase.CLEARED,
    (Phase.CONFIRMED, Event.SEEN): Phase.CONFIRMED,
    (Phase.CONFIRMED, Event.BELIEVED): Phase.CONFIRMED,
    (Phase.CONFIRMED, Event.GONE): Phase.HEALED,
    (Phase.HEALED, Event.SEEN): Phase.HEALED,
    (Phase.HEALED, Event.BELIEVED): Phase.CONFIRMED,
    (Phase.HEALED, Event.GONE): Phase.HEALED,
    (Phase.HEALED, Event.EXPIRED): Phase.CLEARED,
}


class Seen(msgspec.Struct, frozen=True):
    """What is wrong with a check at this moment."""

    check: str
    state: str
    level: Level
    freeze: str = ""
    message: str = ""


class FaultBook:
    """One fault a check, with its phase; what is over moves to the history."""

    def __init__(self, clear_s: float) -> None:
        self._clear_ns = round(clear_s * 1e9)
        self._open: dict[str, Fault] = {}
        self._clear_at_ns: dict[str, int] = {}
        self._own_clear_ns: dict[str, int] = {}
        self._history: deque[Fault] = deque(maxlen=HISTORY)

    def restore(self, faults: tuple[Fault, ...], now_ns: int) -> None:
        """Goes on where a monitor that was killed had stopped."""
        for fault in faults:
            self._open[fault.check] = fault
            if fault.phase is Phase.HEALED:
                self._clear_at_ns[fault.check] = now_ns + self._clear_ns

    def clear_after(self, check: str, clear_s: float) -> None:
        """How long a fault of this check must stay away."""
        self._own_clear_ns[check] = round(clear_s * 1e9)

    def on_bad(self, seen: Seen, now_ns: int, *, believed: bool) -> Fault | None:
        """A check is bad; the fault when others should know of a change."""
        event = Event.BELIEVED if believed else Event.SEEN
        old = self._open.get(seen.check)
        phase = TRANSITIONS[old.phase if old else Phase.CLEARED, event]
        if old is None:
            count = 1 if phase is Phase.CONFIRMED else 0
            new = Fault(
                seen.check, seen.state, seen.level, phase, now_ns, now_ns, count, seen.freeze, seen.message
            )
        else:
            confirmed = phase is Phase.CONFIRMED and old.phase is not Phase.CONFIRMED
            new = msgspec.structs.replace(old, phase=phase, last_ns=now_ns, count=old.count + confirmed)
            if believed:
                new = msgspec.structs.replace(new, state=seen.state, level=seen.level, message=seen.message)
            if confirmed and old.phase is Phase.PENDING:
                new = msgspec.structs.replace(new, freeze=seen.freeze)
        self._open[seen.check] = new
        if phase is not Phase.HEALED:
            self._clear_at_ns.pop(seen.check, None)
        known = old is not None and (old.phase, old.state, old.level) == (new.phase, new.state, new.level)
        return None if known or phase is Phase.PENDING else new

    def on_good(self, check: str, now_ns: int) -> Fault | None:
        """A check is well; the fault when others should know of a change."""
        old = self._open.get(check)
        if old is None:
            return None
        phase = TRANSITIONS[old.phase, Event.GONE]
        if phase is old.phase:
            return None
        if phase is Phase.CLEARED:
            del self._open[check]  # it was never believed: nobody was told of it
            return None
        healed = msgspec.structs.replace(old, phase=phase)
        self._open[check] = healed
        self._clear_at_ns[check] = now_ns + self._own_clear_ns.get(check, self._clear_ns)
        return healed

    def forget(self, check: str, now_ns: int) -> Fault | None:
        """The check was withdrawn: its fault is over."""
        self._own_clear_ns.pop(check, None)
        healed = self.on_good(check, now_ns)
        return self._clear(check) if check in self._open else healed

    def on_timer(self, now_ns: int) -> list[Fault]:
        """Faults that have stayed away for long enough."""
        due = [check for check, at_ns in self._clear_at_ns.items() if at_ns <= now_ns]
        return [self._clear(check) for check in due]

    def _clear(self, check: str) -> Fault:
        old = self._open.pop(check)
        self._clear_at_ns.pop(check, None)
        cleared = msgspec.structs.replace(old, phase=TRANSITIONS[old.phase, Event.EXPIRED])
        self._history.append(cleared)
        return cleared

    def confirmed(self) -> list[Fault]:
        """Confirmed faults, worst first, then the oldest."""
        found = [fault for fault in self._open.values() if fault.phase is Phase.CONFIRMED]
        return sorted(found, key=lambda fault: (-WORSE[fault.level], fault.first_ns))

    def open(self) -> tuple[Fault, ...]:
        """Everything that is not cleared, newest first."""
        return tuple(sorted(self._open.values(), key=lambda fault: -fault.last_ns))

    def cleared(self) -> tuple[Fault, ...]:
        """What is over, newest first."""
        return tuple(reversed(self._history))
