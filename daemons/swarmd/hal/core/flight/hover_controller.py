"""Cascade of hovering vehicles: velocity, climb, attitude and rate loops above the airframe's actuators."""

import math
from abc import ABC, abstractmethod
from typing import Final

import msgspec

from swarmd.hal.core.flight.climb_loop import ClimbLoop
from swarmd.hal.core.flight.control_law import changed
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.mixer import IDLE, Mixer
from swarmd.hal.core.flight.rate_loop import RateLoop
from swarmd.hal.core.flight.velocity_loop import VelocityLoop
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.airframe import MultirotorAirframe
from swarmware.model.hover_gains import HoverGains, HoverLimits
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint


def body_rates(
    state: FlightState,
    roll_rad: float,
    pitch_rad: float,
    yaw_rate_rad_s: float,
    kp_1_s: float,
    limit_rad_s: float,
) -> Vector:
    """Commanded body rates for a commanded roll, pitch and yaw rate.

    Source: Beard, McLain 2012, "Small Unmanned Aircraft", equation 3.3.
    """
    roll_rate = _clipped(kp_1_s * (roll_rad - state.roll_rad), limit_rad_s)
    pitch_rate = _clipped(kp_1_s * (pitch_rad - state.pitch_rad), limit_rad_s)
    cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
    cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
    return (
        roll_rate - sp * yaw_rate_rad_s,
        cr * pitch_rate + sr * cp * yaw_rate_rad_s,
        -sr * pitch_rate + cr * cp * yaw_rate_rad_s,
    )


def _clipped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


_LIFT_M_S: Final = 0.1
"""Commanded climb rate above which a landed vehicle takes off."""
_TILT_MARGIN_RAD: Final = 0.35
"""Margin above the maximum commanded tilt before a tilt is a fault. Measured in gusts with a standard
deviation of 1 m/s and steps of velocity: up to 0.1 rad (tests/simulation/flight/starvation.py)."""
_SAMPLED_RATIOS: Final = (0.8, 0.4, 0.15)
"""Maximum product of gain and hold time for the rate and climb loops, the attitude loop and the velocity
loop. A sampled integrator does not overshoot below 1, and each loop must be slower than its inner loop."""
_TILT_MIN: Final = 0.5
"""Minimum cosine of the tilt for which thrust is increased to keep the height."""


def softened(gains: HoverGains, gap_s: float) -> HoverGains:
    """Reduces gains so that loops stay stable when their outputs are held for up to `gap_s`."""
    if gap_s == 0.0:
        return gains
    rate_1_s, attitude_1_s, velocity_1_s = (ratio / gap_s for ratio in _SAMPLED_RATIOS)
    rate = min(1.0, rate_1_s / gains.rate_kp_1_s) if gains.rate_kp_1_s else 1.0
    velocity = min(1.0, velocity_1_s / gains.velocity_kp_1_s) if gains.velocity_kp_1_s else 1.0
    climb = min(1.0, rate_1_s / gains.climb_kp_1_s) if gains.climb_kp_1_s else 1.0
    return msgspec.structs.replace(
        gains,
        rate_kp_1_s=gains.rate_kp_1_s * rate,
        # an integral gain falls with the square, so that the damping of the loop stays
        rate_ki_1_s2=gains.rate_ki_1_s2 * rate * rate,
        yaw_rate_kp_1_s=min(gains.yaw_rate_kp_1_s, rate_1_s),
        yaw_rate_ki_1_s2=gains.yaw_rate_ki_1_s2 * rate * rate,
        attitude_kp_1_s=min(gains.attitude_kp_1_s, attitude_1_s),
        velocity_kp_1_s=gains.velocity_kp_1_s * velocity,
        velocity_ki_1_s2=gains.velocity_ki_1_s2 * velocity * velocity,
        climb_kp_1_s=gains.climb_kp_1_s * climb,
        climb_ki_1_s2=gains.climb_ki_1_s2 * climb * climb,
    )


class Demand(msgspec.Struct, frozen=True, gc=False):
    """Demand of the control loops on the actuators in one step."""

    lift_m_s2: float
    """Upward acceleration, including gravity."""
    upright: float
    """Cosine of the tilt, the ratio of lift to thrust."""
    rates_rad_s: Vector
    """Commanded rates about the body axes."""
    turn: Vector
    """Moments about the body axes, in N m; angular accelerations for an inertia of 1."""


class HoverController(ABC):
    """Base of the control laws of hovering airframes, which differ in the outputs for a demand."""

    follows_nose: Final = False

    def __init__(
        self, gains: HoverGains, limits: HoverLimits, inertia_kg_m2: Vector, ground: ActuatorOutputs
    ) -> None:
        """`ground`: outputs of an armed vehicle that is to stay on the ground."""
        self._gains = self._in_force = gains
        self._gap_s = 0.0
        self._limits = limits
        self._ground = ground
        self._rate = RateLoop(inertia_kg_m2)
        self._velocity = VelocityLoop()
        self._climb = ClimbLoop()
        self._whole = True
        """True if the actuators produced the whole last demand."""
        self.lift_ratio = 0.0
        """Ratio of the last commanded lift to the weight."""

    @abstractmethod
    def _actuated(self, demand: Demand) -> tuple[ActuatorOutputs, float, bool]:
        """Outputs for a demand, ratio of lift to weight, and True if the outputs produce the whole demand."""

    @property
    def gains(self) -> dict[str, float]:
        """Gains in force, by name."""
        return msgspec.structs.asdict(self._gains)

    def set_gains(self, gains: dict[str, float]) -> None:
        """Changes gains by name, also in flight (S2.46); other gains stay.

        Raises: Denied when a name is unknown or a value out of range; no gain is changed then.
        """
        self._gains = changed(self._gains, gains)
        # gaps that were seen still limit the new gains
        self._in_force = softened(self._gains, self._gap_s)

    @property
    def acceleration_m_s2(self) -> float:
        """Horizontal acceleration of the last command, without the part against the wind."""
        return math.hypot(*self._velocity.acceleration_m_s2)

    def update(self, wanted: Setpoint, state: FlightState, *, landed: bool, dt_s: float) -> ActuatorOutputs:
        """Computes the outputs of one control step of an armed vehicle."""
        if landed:
            # an integral that grows against the ground would throw the vehicle up at the take-off
            self.reset()
            if wanted.vz_m_s < _LIFT_M_S:
                self.lift_ratio = 0.0
                return self._ground
        gains, limits = self._in_force, self._limits
        roll, pitch = self._velocity.tilt_rad(gains, limits, (wanted.vx_m_s, wanted.vy_m_s), state, dt_s)
        climb = self._climb.acceleration_m_s2(gains, limits, wanted.vz_m_s, state, dt_s)
        yaw_rate = max(-limits.turn_max_rad_s, min(limits.turn_max_rad_s, wanted.wz_rad_s))
        rates = body_rates(state, roll, pitch, yaw_rate, gains.attitude_kp_1_s, limits.rate_max_rad_s)
        # the integral of the rate loop is frozen while the actuators are at their limits (anti-windup)
        turn = self._rate.moment_n_m(gains, rates, state.rates_rad_s, dt_s, learns=self._whole)
        # bounded, because near 90° no thrust keeps the height
        upright = max(_TILT_MIN, math.cos(state.roll_rad) * math.cos(state.pitch_rad))
        demand = Demand(GRAVITY_M_S2 + climb, upright, rates, turn)
        outputs, self.lift_ratio, self._whole = self._actuated(demand)
        return outputs

    @property
    def tilt_limit_rad(self) -> float:
        """Tilt above all commanded tilts, beyond which the vehicle counts as out of control."""
        return self._limits.tilt_max_rad + _TILT_MARGIN_RAD

    def expect_gap(self, gap_s: float) -> None:
        """Takes the time for which outputs may be held, and reduces the gains accordingly."""
        if gap_s != self._gap_s:
            self._gap_s = gap_s
            self._in_force = softened(self._gains, gap_s)

    def resume(self) -> None:
        """Continues after a gap; integrals stay, and the commanded height begins at the vehicle's height."""
        self._climb.resume()

    def reset(self) -> None:
        """Clears all integrals when the vehicle is disarmed or on the ground."""
        self._rate.reset()
        self._velocity.reset()
        self._climb.reset()


_THRUST_MAX_RATIO: Final = 0.9
_THRUST_MIN_RATIO: Final = 0.1
"""Limits of the ratio of common thrust to its maximum; the rest is reserved for moments."""


class MultirotorController(HoverController):
    """Control law of a multirotor with any number of rotors, as the file of its airframe describes them."""

    def __init__(self, airframe: MultirotorAirframe) -> None:
        idle = ActuatorOutputs((IDLE,) * len(airframe.rotors))
        super().__init__(airframe.gains, airframe.limits, airframe.body.inertia_kg_m2, idle)
        self._airframe = airframe
        self._mixer = Mixer(airframe)

    def _actuated(self, demand: Demand) -> tuple[ActuatorOutputs, float, bool]:
        airframe = self._airframe
        full_n = airframe.motor.thrust_max_n * len(airframe.rotors)
        thrust = airframe.body.mass_kg * demand.lift_m_s2 / demand.upright
        thrust = max(_THRUST_MIN_RATIO * full_n, min(_THRUST_MAX_RATIO * full_n, thrust))
        motors, whole = self._mixer.outputs(thrust, demand.turn)
        return ActuatorOutputs(motors), thrust * demand.upright / airframe.hover_thrust_n, whole
