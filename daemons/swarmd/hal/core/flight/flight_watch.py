"""Detection of faults of a flight: a late control loop, excessive tilt, unexpected ground contact."""

import math
from collections import deque
from enum import StrEnum
from typing import Final

import msgspec

from swarmd.hal.core.condition import Condition
from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.types.health import Level

LATE_PERIODS: Final = 5
"""Number of periods without a control step above which the loop is late."""
AWAY_S: Final = 0.5
"""Duration of a gap above which it is an error, half of the time for which outputs are held."""
STARVED_S: Final = 1.0
"""Sum of the gaps within `_WINDOW_NS` above which the loop is starved, a third of the time."""
_WINDOW_NS: Final = 3_000_000_000
SHOWN_NS: Final = 3_000_000_000
"""Time for which a fault is reported after its cause, long enough for reactions with a hold time."""
SETTLED_NS: Final = 1_000_000_000
"""Time in the air after which ground contact is unexpected; a vehicle that takes off may touch again."""
DESCENT_M_S: Final = -0.05
"""Commanded climb rate below which ground contact is expected."""

LOOP: Final = Condition("flight/loop", "The control loop of the flight is in time")
TILT: Final = Condition("flight/tilt", "The vehicle tilts no more than its control law commands")
CONTACT: Final = Condition("flight/contact", "The vehicle touches the ground only where it lands")


class LoopState(StrEnum):
    """States of the check of the control loop that are faults."""

    LATE = "late"
    """A gap of some periods, which is only a warning."""
    STARVED = "starved"
    """Gaps that add up to a third of the time."""
    AWAY = "away"
    """A gap of half a second or more."""
    LOST = "lost"
    """The motors stopped in a gap, and the flight was not continued."""


class FlightStep(msgspec.Struct, frozen=True, gc=False):
    """Data of one control step of an armed vehicle from which faults are detected."""

    state: FlightState
    gap_s: float
    """Time since the previous inertial sample."""
    climb_m_s: float
    """Climb rate of the set-point."""
    landed: bool


class FlightWatch:
    """Evaluates each control step; `conditions` returns the checks of the flight with their freeze frames.

    `tilt_limit_rad`: tilt beyond which the vehicle is out of control; `held_s`: time for which outputs are
    held.
    """

    def __init__(self, period_s: float, tilt_limit_rad: float, held_s: float) -> None:
        self._late_s = LATE_PERIODS * period_s
        self._period_s = period_s
        self._tilt_limit_rad = tilt_limit_rad
        self._held_s = held_s
        self._gaps: deque[tuple[int, float]] = deque()
        """Gaps of the last seconds, each with the instant of its end."""
        self._until_ns: dict[str, int] = {}
        """End of each reported fault, by the name of its check."""
        self._stated = {one.name: one for one in (LOOP, TILT, CONTACT)}
        self._changed = dict(self._stated)
        self._airborne_ns: int | None = None
        """Instant of the take-off, or None while the vehicle is on the ground."""

    def on_step(self, step: FlightStep, now_ns: int) -> bool:
        """Takes a control step of an armed vehicle; returns True after unexpected ground contact."""
        flies = self._airborne_ns is not None
        if flies:
            self._judge_gap(step, now_ns)
            self._judge_tilt(step.state, now_ns)
        if not step.landed:
            # the first step in the air begins the flight
            self._airborne_ns = now_ns if self._airborne_ns is None else self._airborne_ns
            return False
        begun_ns, self._airborne_ns = self._airborne_ns, None
        # neither a take-off that touches again nor a commanded landing is a fault
        if begun_ns is None or now_ns - begun_ns < SETTLED_NS or step.climb_m_s < DESCENT_M_S:
            return False
        self._state(
            CONTACT,
            "touched",
            f"ground touched after {(now_ns - begun_ns) / 1e9:.1f} s, {_described(step)}",
            now_ns,
        )
        return True

    def on_handover(self, stamp_ns: int) -> None:
        """Takes that the vehicle already was in flight at this instant, under the previous process."""
        self._airborne_ns = stamp_ns

    def on_disarmed(self) -> None:
        """Takes that the motors are off, which ends the flight."""
        self._airborne_ns = None
        self._gaps.clear()

    def on_lost(self, reason: str, now_ns: int) -> None:
        """Takes that the flight cannot be continued after a gap."""
        self._state(LOOP, LoopState.LOST, reason, now_ns)

    def expected_gap_s(self, now_ns: int) -> float:
        """Gap that may occur again, the second longest of the last seconds, or 0 with fewer than two gaps."""
        self._forget(now_ns)
        # a single long gap does not justify softer gains
        return sorted(gap_s for _, gap_s in self._gaps)[-2] if len(self._gaps) > 1 else 0.0

    def conditions(self, now_ns: int) -> list[Condition]:
        """Conditions that have changed since the last call."""
        for name in [name for name, until_ns in self._until_ns.items() if now_ns >= until_ns]:
            del self._until_ns[name]
            ended = self._stated[name]
            self._put(Condition(name, ended.description))
        changed = list(self._changed.values())
        self._changed.clear()
        return changed

    def _forget(self, now_ns: int) -> None:
        while self._gaps and now_ns - self._gaps[0][0] > _WINDOW_NS:
            self._gaps.popleft()

    def _judge_gap(self, step: FlightStep, now_ns: int) -> None:
        self._forget(now_ns)
        if step.gap_s < self._late_s:
            return
        self._gaps.append((now_ns, step.gap_s))
        total_s = sum(gap_s for _, gap_s in self._gaps)
        if step.gap_s >= AWAY_S:
            state = LoopState.AWAY
        else:
            state = LoopState.STARVED if total_s >= STARVED_S else LoopState.LATE
        ended = ", motors stopped in it" if step.gap_s > self._held_s else ""
        gap = f"{step.gap_s:.2f} s without a step, {step.gap_s / self._period_s:.0f} periods{ended}"
        self._state(LOOP, state, f"{gap}; {total_s:.1f} s of the last 3; {_described(step)}", now_ns)

    def _judge_tilt(self, state: FlightState, now_ns: int) -> None:
        tilt_rad = tilt(state)
        if tilt_rad > self._tilt_limit_rad:
            limit = f"limit {math.degrees(self._tilt_limit_rad):.0f}°"
            self._state(
                TILT, "beyond", f"tilt {math.degrees(tilt_rad):.0f}°, {limit}; {_where(state)}", now_ns
            )

    def _state(self, of: Condition, state: str, detail: str, now_ns: int) -> None:
        """Reports a fault; a worse fault of the same check stays until its end."""
        level: Level = "warn" if state is LoopState.LATE else "error"
        known = self._stated[of.name]
        # a short gap must not cover the error of a longer one
        if known.level == "error" and level == "warn":
            return
        self._until_ns[of.name] = now_ns + SHOWN_NS
        if known.state != state:
            self._put(Condition(of.name, of.description, state, level, detail))

    def _put(self, condition: Condition) -> None:
        self._stated[condition.name] = self._changed[condition.name] = condition


def tilt(state: FlightState) -> float:
    """Angle between the upward body axis and the vertical."""
    return math.acos(max(-1.0, min(1.0, math.cos(state.roll_rad) * math.cos(state.pitch_rad))))


def _where(state: FlightState) -> str:
    return f"height {state.position_m[2]:.1f} m, climb {state.velocity_m_s[2]:.1f} m/s"


def _described(step: FlightStep) -> str:
    return f"{_where(step.state)}, tilt {math.degrees(tilt(step.state)):.0f}°"
