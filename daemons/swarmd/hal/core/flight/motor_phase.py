"""Phase of motors and flight, for a vehicle whose firmware does not report it (S0.8, S1.7)."""

from enum import StrEnum
from typing import Final

import msgspec

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.errors import Denied
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder, ChassisReport

TILT_MAX_RAD: Final = 0.5
"""Maximum tilt for arming; a steeper vehicle has fallen over, or its attitude is not known yet."""
SILENCE_NS: Final = 500_000_000
"""Age of the newest inertial sample above which the attitude is too uncertain to arm."""
LIFT_RATIO: Final = 1.02
"""Ratio of commanded lift to weight above which a vehicle leaves the ground."""
LIFT_NS: Final = 200_000_000
"""Time for which the lift must exceed `LIFT_RATIO`, because the motors follow with a lag."""
SINK_RATIO: Final = 0.75
"""Ratio of commanded lift to weight below which a vehicle that does not sink is on the ground."""
REST_NS: Final = 600_000_000
"""Time below `SINK_RATIO` before a landing; the begin of a descent has as little lift for 0.2 s."""
FALL_NS: Final = 1_000_000_000
"""Time at rest after which a vehicle that was killed in the air counts as being on the ground."""
STILL_M_S: Final = 0.25
"""Maximum vertical speed of a vehicle on the ground, due to noise of the estimate."""
STILL_RAD_S: Final = 0.3
"""Maximum body rates of a vehicle on the ground."""
DESCENT_M_S: Final = -0.05
"""Commanded climb rate below which a descent is intended."""


class MotorPhase(StrEnum):
    """Phase of the motors and of the flight."""

    DISARMED = "disarmed"
    GROUNDED = "grounded"
    """Motors armed, vehicle on the ground."""
    AIRBORNE = "airborne"
    FALLING = "falling"
    """Motors killed in the air."""


class MotorEvent(StrEnum):
    """Event that changes the phase."""

    ARM = "arm"
    DISARM = "disarm"
    KILL = "kill"
    LIFTED = "lifted"
    RESTED = "rested"


PHASES: Final = {
    (MotorPhase.DISARMED, MotorEvent.ARM): MotorPhase.GROUNDED,
    (MotorPhase.GROUNDED, MotorEvent.DISARM): MotorPhase.DISARMED,
    (MotorPhase.GROUNDED, MotorEvent.KILL): MotorPhase.DISARMED,
    (MotorPhase.GROUNDED, MotorEvent.LIFTED): MotorPhase.AIRBORNE,
    (MotorPhase.AIRBORNE, MotorEvent.RESTED): MotorPhase.GROUNDED,
    (MotorPhase.AIRBORNE, MotorEvent.KILL): MotorPhase.FALLING,
    (MotorPhase.FALLING, MotorEvent.RESTED): MotorPhase.DISARMED,
}
"""Transitions of the phase; other events have no effect."""

_ARMED: Final = frozenset({MotorPhase.GROUNDED, MotorPhase.AIRBORNE})
_LANDED: Final = frozenset({MotorPhase.DISARMED, MotorPhase.GROUNDED})


class FlightSample(msgspec.Struct, frozen=True, gc=False):
    """Data of one control step from which the phase is determined."""

    state: FlightState
    lift_ratio: float
    """Ratio of commanded lift to weight."""
    climb_m_s: float
    """Climb rate of the set-point."""


class MotorSwitch:
    """Executes the orders to the motors, and detects take-off and landing from commands and measurements.

    A vehicle is in flight when the commanded lift has exceeded its weight. It has landed when a descent is
    commanded, the lift is low, and the vehicle does not sink.

    `held_s`: age of the newest inertial sample above which the motors stop. `flies_ns`: instant at which the
    driver has taken over a vehicle in flight, or None for a disarmed vehicle.
    """

    def __init__(self, held_s: float = 1.0, flies_ns: int | None = None) -> None:
        self._held_ns = round(held_s * 1e9)
        self._phase = MotorPhase.DISARMED if flies_ns is None else MotorPhase.AIRBORNE
        self._answer = (0, "")
        """Number of the newest order, and the reason of its refusal."""
        self._sample: FlightSample | None = None
        self._sample_ns = flies_ns or 0
        self._since_ns: int | None = None
        """Begin of the present indication of another phase."""

    @property
    def phase(self) -> MotorPhase:
        """Present phase of motors and flight."""
        return self._phase

    @property
    def report(self) -> ChassisReport:
        """State of the vehicle as the report of a chassis."""
        return ChassisReport(self._phase in _ARMED, self._phase in _LANDED, *self._answer)

    def on_order(self, order: ChassisOrder, now_ns: int) -> ChassisReport:
        """Executes or refuses an order, once even if repeated; returns the report that answers it."""
        # orders are repeated until they are answered, and must not be executed twice
        if order.number > self._answer[0]:
            refusal = ""
            try:
                self._execute(order.action, now_ns)
            except Denied as error:
                refusal = str(error)
            self._answer = (order.number, refusal)
        return self.report

    def _execute(self, action: ChassisAction, now_ns: int) -> None:
        flies = self._phase not in _LANDED
        match action:
            case ChassisAction.ARM:
                if flies:
                    raise Denied("arming in the air: expected a landed vehicle")
                self._check_attitude(now_ns)
                self._change(MotorEvent.ARM)
            case ChassisAction.DISARM:
                if flies:
                    raise Denied("disarming in the air: expected a landed vehicle")
                self._change(MotorEvent.DISARM)
            case ChassisAction.KILL:
                self._change(MotorEvent.KILL)
            case ChassisAction.CALIBRATE:
                raise Denied(
                    "calibration: motor controllers learn the widths of pulses at their power-up; expected"
                    " the procedure of their maker"
                )
            case _:
                raise Denied(f"{action}: not supported by this driver")

    def _check_attitude(self, now_ns: int) -> None:
        """Checks that the attitude is known and level. Raises: Denied."""
        sample = self._sample
        if sample is None or now_ns - self._sample_ns > SILENCE_NS:
            raise Denied("arming: no inertial samples; expected a known attitude")
        tilt = max(abs(sample.state.roll_rad), abs(sample.state.pitch_rad))
        if tilt > TILT_MAX_RAD:
            raise Denied(f"arming: tilted by {tilt:.2f} rad, expected at most {TILT_MAX_RAD:g}")

    def on_step(self, sample: FlightSample, now_ns: int) -> None:
        """Takes a step of the flight controller, which may change the phase."""
        self._sample, self._sample_ns = sample, now_ns
        event, after_ns = self._expected(sample)
        if event is None:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        elif now_ns - self._since_ns >= after_ns:
            self._change(event)

    def _expected(self, sample: FlightSample) -> tuple[MotorEvent | None, int]:
        """Event that the sample indicates, or None, and the time for which the indication must last."""
        state = sample.state
        still = abs(state.velocity_m_s[2]) < STILL_M_S
        match self._phase:
            # by the command, since no sensor shows contact with the ground
            case MotorPhase.GROUNDED if sample.lift_ratio > LIFT_RATIO:
                return MotorEvent.LIFTED, LIFT_NS
            case MotorPhase.AIRBORNE if (
                still and sample.climb_m_s < DESCENT_M_S and sample.lift_ratio < SINK_RATIO
            ):
                return MotorEvent.RESTED, REST_NS
            case MotorPhase.FALLING if still and max(map(abs, state.rates_rad_s)) < STILL_RAD_S:
                return MotorEvent.RESTED, FALL_NS
        return None, 0

    def stop_if_blind(self, now_ns: int) -> bool:
        """Stops the motors when inertial samples are missing for too long; returns True if it did."""
        if self._phase not in _ARMED or now_ns - self._sample_ns <= self._held_ns:
            return False
        self._change(MotorEvent.KILL)
        return True

    def outputs(self, outputs: ActuatorOutputs) -> ActuatorOutputs:
        """Outputs for the actuators, without motor outputs unless the motors are armed."""
        # servos stay under control: they do not drive the vehicle
        return outputs if self._phase in _ARMED else ActuatorOutputs((), outputs.servos)

    def _change(self, event: MotorEvent) -> None:
        self._phase = PHASES.get((self._phase, event), self._phase)
        self._since_ns = None
