"""Whether the motors of a vehicle turn and whether it flies, where no firmware says so (S0.8, S1.7)."""

from enum import StrEnum
from typing import Final

import msgspec

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.errors import Denied
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder, ChassisReport

TILT_MAX_RAD: Final = 0.5
"""A vehicle that stands steeper has fallen over, or its attitude is not known yet: it is not armed."""
SILENCE_NS: Final = 500_000_000
"""Age of the newest inertial sample above which the attitude is too uncertain to arm."""
LIFT_RATIO: Final = 1.02
"""Commanded lift over the weight from which a vehicle leaves the ground."""
LIFT_NS: Final = 200_000_000
"""Time for which it must last: the motors follow with a lag."""
SINK_RATIO: Final = 0.75
"""Commanded lift over the weight below which a vehicle that does not sink stands on the ground."""
REST_NS: Final = 600_000_000
"""Time for which that must last: at the begin of a descent in the air the lift is as low for 0.2 s."""
FALL_NS: Final = 1_000_000_000
"""Time at rest after which a vehicle that was killed in the air counts as fallen."""
STILL_M_S: Final = 0.25
"""Vertical speed of a vehicle on the ground: noise of the estimate."""
STILL_RAD_S: Final = 0.3
"""Rates of a vehicle on the ground."""
DESCENT_M_S: Final = -0.05
"""Commanded climb rate below which a vehicle descends."""


class MotorPhase(StrEnum):
    """Phase of the motors and of the flight."""

    DISARMED = "disarmed"
    GROUNDED = "grounded"
    """Armed, on the ground."""
    AIRBORNE = "airborne"
    FALLING = "falling"
    """Killed in the air."""


class MotorEvent(StrEnum):
    """What changes the phase."""

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
"""Transitions; any other event has no effect."""

_ARMED: Final = frozenset({MotorPhase.GROUNDED, MotorPhase.AIRBORNE})
_LANDED: Final = frozenset({MotorPhase.DISARMED, MotorPhase.GROUNDED})


class FlightSample(msgspec.Struct, frozen=True, gc=False):
    """One step of the flight controller, as the phase depends on it."""

    state: FlightState
    lift_ratio: float
    """Commanded lift over the weight."""
    climb_m_s: float
    """Climb rate of the set-point."""


class MotorSwitch:
    """Executes the orders to the motors, and finds out by what is commanded and measured whether it flies.

    A vehicle flies when it has commanded more lift than its weight; it has landed when it commands a descent
    with little lift and does not sink.

    `held_s`: age of the newest inertial sample above which the motors stop. `flies_ns`: instant at which the
    driver has taken over a vehicle in flight; None: the vehicle is disarmed.
    """

    def __init__(self, held_s: float = 1.0, flies_ns: int | None = None) -> None:
        self._held_ns = round(held_s * 1e9)
        self._phase = MotorPhase.DISARMED if flies_ns is None else MotorPhase.AIRBORNE
        self._answer = (0, "")
        """Number of the newest order, and the reason of its refusal."""
        self._sample: FlightSample | None = None
        self._sample_ns = flies_ns or 0
        self._since_ns: int | None = None
        """Begin of what would change the phase if it lasted."""

    @property
    def phase(self) -> MotorPhase:
        """The phase of motors and flight."""
        return self._phase

    @property
    def report(self) -> ChassisReport:
        """The state as a chassis reports it."""
        return ChassisReport(self._phase in _ARMED, self._phase in _LANDED, *self._answer)

    def on_order(self, order: ChassisOrder, now_ns: int) -> ChassisReport:
        """Executes an order once, or refuses it with the reason; the report answers it."""
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
                raise Denied(f"{action}: this driver does not know it")

    def _check_attitude(self, now_ns: int) -> None:
        """Check that the attitude is known, and level. Raises: Denied."""
        sample = self._sample
        if sample is None or now_ns - self._sample_ns > SILENCE_NS:
            raise Denied("arming: no inertial samples; expected a known attitude")
        tilt = max(abs(sample.state.roll_rad), abs(sample.state.pitch_rad))
        if tilt > TILT_MAX_RAD:
            raise Denied(f"arming: tilted by {tilt:.2f} rad, expected at most {TILT_MAX_RAD:g}")

    def on_step(self, sample: FlightSample, now_ns: int) -> None:
        """Takes a step of the flight controller; the phase may change."""
        self._sample, self._sample_ns = sample, now_ns
        event, after_ns = self._expected(sample)
        if event is None:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        elif now_ns - self._since_ns >= after_ns:
            self._change(event)

    def _expected(self, sample: FlightSample) -> tuple[MotorEvent | None, int]:
        """What happens if all remains as it is, and after which time; None: nothing."""
        state = sample.state
        still = abs(state.velocity_m_s[2]) < STILL_M_S
        match self._phase:
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
        """Stops the motors when inertial samples are missing for too long; whether it did."""
        if self._phase not in _ARMED or now_ns - self._sample_ns <= self._held_ns:
            return False
        self._change(MotorEvent.KILL)
        return True

    def outputs(self, outputs: ActuatorOutputs) -> ActuatorOutputs:
        """What the actuators get: without motors unless they are armed."""
        return outputs if self._phase in _ARMED else ActuatorOutputs((), outputs.servos)

    def _change(self, event: MotorEvent) -> None:
        self._phase = PHASES.get((self._phase, event), self._phase)
        self._since_ns = None
