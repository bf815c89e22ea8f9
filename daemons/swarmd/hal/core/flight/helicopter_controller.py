"""Controller of a helicopter: the cascade of vehicles that hover, above cyclic, collective and pedal."""

import math
from typing import Final

import msgspec

from swarmd.hal.core.flight.attitude_loop import body_rates
from swarmd.hal.core.flight.climb_loop import ClimbLoop
from swarmd.hal.core.flight.control_law import changed
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.rate_loop import RateLoop
from swarmd.hal.core.flight.velocity_loop import VelocityLoop
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint

_LIFT_M_S: Final = 0.1
"""Commanded climb rate above which a landed vehicle takes off."""
_GROUND: Final = ActuatorOutputs((1.0,), (0.0, 0.0, -0.8, 0.0))
"""On the ground the rotor turns at its speed with little pitch."""
_TILT_MIN: Final = 0.5
"""Smallest cosine of the tilt by which thrust is increased to keep the height."""
_LIFT_MIN, _LIFT_MAX = 0.4, 1.7
"""Limits of the commanded thrust over the weight."""


class HelicopterController:
    """Cascade of a helicopter: that of a multirotor, with a rotor that tilts instead of a mixer."""

    __slots__ = ("_airframe", "_climb", "_gains", "_rate", "_velocity", "_whole", "lift_ratio")

    follows_nose: Final = False

    def __init__(self, airframe: HelicopterAirframe) -> None:
        self._airframe = airframe
        self._gains = airframe.gains
        self._rate = RateLoop((1.0, 1.0, 1.0))
        self._velocity = VelocityLoop()
        self._climb = ClimbLoop()
        self._whole = True
        """Whether no servo was at its end."""
        self.lift_ratio = 0.0
        """Lift over the weight that it commanded last."""

    @property
    def gains(self) -> dict[str, float]:
        """Gains in force, by name."""
        return msgspec.structs.asdict(self._gains)

    def set_gains(self, gains: dict[str, float]) -> None:
        """Changes gains by name, also in flight (S2.46); others stay.

        Raises: Denied when a name is unknown, or a value out of range; none is changed then.
        """
        self._gains = changed(self._gains, gains)

    @property
    def acceleration_m_s2(self) -> float:
        """Horizontal acceleration that it commanded last, without that against the wind."""
        return math.hypot(*self._velocity.acceleration_m_s2)

    def update(self, wanted: Setpoint, state: FlightState, *, landed: bool, dt_s: float) -> ActuatorOutputs:
        """The outputs of this control step of an armed vehicle."""
        if landed:
            self.reset()
            if wanted.vz_m_s < _LIFT_M_S:
                self.lift_ratio = 0.0
                return _GROUND
        airframe, gains, limits = self._airframe, self._gains, self._airframe.limits
        roll, pitch = self._velocity.tilt_rad(gains, limits, (wanted.vx_m_s, wanted.vy_m_s), state, dt_s)
        climb = self._climb.acceleration_m_s2(gains, limits, wanted.vz_m_s, state, dt_s)
        upright = max(_TILT_MIN, math.cos(state.roll_rad) * math.cos(state.pitch_rad))
        lift = min(max((GRAVITY_M_S2 + climb) / upright, _LIFT_MIN * GRAVITY_M_S2), _LIFT_MAX * GRAVITY_M_S2)
        self.lift_ratio = lift * upright / GRAVITY_M_S2
        collective = airframe.collective(airframe.body.mass_kg * lift)
        yaw_rate = min(max(wanted.wz_rad_s, -limits.turn_max_rad_s), limits.turn_max_rad_s)
        rates = body_rates(state, roll, pitch, yaw_rate, gains.attitude_kp_1_s, limits.rate_max_rad_s)
        # with an inertia of 1 the moments of the rate loop are angular accelerations
        turning = self._rate.moment_n_m(gains, rates, state.rates_rad_s, dt_s, learns=self._whole)
        lateral, longitudinal = self._cyclic(turning, rates)
        servos = (lateral, longitudinal, collective, self._pedal(turning[2], rates[2], collective))
        self._whole = all(abs(servo) < 1.0 for servo in servos)
        a, b, c, d = (min(max(servo, -1.0), 1.0) for servo in servos)
        return ActuatorOutputs((1.0,), (a, b, c, d))

    def _cyclic(self, turning: Vector, rates: Vector) -> tuple[float, float]:
        """Lateral and longitudinal control at which the disc, once it has settled, turns the body so.

        The disc lags behind a body that turns by the time constant of flapping: the control adds that tilt.
        """
        of = self._airframe.derivatives
        b, a = turning[0] / of.l_b, -turning[1] / of.m_a
        across = b - of.b_a * a + of.tau_f_s * rates[0]
        along = a - of.a_b * b - of.tau_f_s * rates[1]
        full = of.a_lon * of.b_lat - of.a_lat * of.b_lon
        return (
            (of.a_lon * across - of.b_lon * along) / full,
            (of.b_lat * along - of.a_lat * across) / full,
        )

    def _pedal(self, turning_rad_s2: float, rate_rad_s: float, collective: float) -> float:
        """Pedal to the left: for the acceleration, and against damping, gyro and the main rotor's torque."""
        of = self._airframe.derivatives
        damped = -of.n_r / of.n_ped - of.k_r / of.k_rfb
        return turning_rad_s2 / of.n_ped + damped * rate_rad_s + of.n_col * collective / of.n_ped

    def reset(self) -> None:
        """Clears all integrals: the vehicle is disarmed or on the ground."""
        self._rate.reset()
        self._velocity.reset()
        self._climb.reset()
