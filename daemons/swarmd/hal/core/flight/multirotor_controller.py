"""Controller of a multirotor: velocity, attitude and rate loop above the mixer."""

import math
from typing import Final

import msgspec

from swarmd.hal.core.flight.attitude_loop import body_rates
from swarmd.hal.core.flight.climb_loop import ClimbLoop
from swarmd.hal.core.flight.control_law import changed
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.mixer import IDLE, Mixer
from swarmd.hal.core.flight.rate_loop import RateLoop
from swarmd.hal.core.flight.velocity_loop import VelocityLoop
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.airframe import MultirotorAirframe
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint

_LIFT_M_S: Final = 0.1
"""Commanded climb rate above which a landed vehicle takes off."""
_THRUST_MAX_RATIO: Final = 0.9
_THRUST_MIN_RATIO: Final = 0.1
"""Limits of the common thrust over its maximum: the rest is for moments."""
_TILT_MIN: Final = 0.5
"""Smallest cosine of the tilt by which thrust is increased to keep the height."""


class MultirotorController:
    """Cascade of a multirotor with any number of rotors; all that differs is in the file of its airframe."""

    __slots__ = (
        "_airframe",
        "_climb",
        "_gains",
        "_idle",
        "_mixer",
        "_rate",
        "_velocity",
        "_whole",
        "lift_ratio",
    )

    follows_nose: Final = False

    def __init__(self, airframe: MultirotorAirframe) -> None:
        self._airframe = airframe
        self._gains = airframe.gains
        self._mixer = Mixer(airframe)
        self._rate = RateLoop(airframe.body.inertia_kg_m2)
        self._velocity = VelocityLoop()
        self._climb = ClimbLoop()
        self._idle = ActuatorOutputs((IDLE,) * len(airframe.rotors))
        self._whole = True
        """Whether the motors produced all that was commanded last."""
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
            self._rate.reset()
            self._velocity.reset()
            if wanted.vz_m_s < _LIFT_M_S:
                self._climb.reset()
                self.lift_ratio = 0.0
                return self._idle
        airframe, gains, limits = self._airframe, self._gains, self._airframe.limits
        roll, pitch = self._velocity.tilt_rad(gains, limits, (wanted.vx_m_s, wanted.vy_m_s), state, dt_s)
        lift = GRAVITY_M_S2 + self._climb.acceleration_m_s2(gains, limits, wanted.vz_m_s, state, dt_s)
        yaw_rate = max(-limits.turn_max_rad_s, min(limits.turn_max_rad_s, wanted.wz_rad_s))
        rates = body_rates(state, roll, pitch, yaw_rate, gains.attitude_kp_1_s, limits.rate_max_rad_s)
        moment = self._rate.moment_n_m(gains, rates, state.rates_rad_s, dt_s, learns=self._whole)
        upright = max(_TILT_MIN, math.cos(state.roll_rad) * math.cos(state.pitch_rad))
        full_n = airframe.motor.thrust_max_n * len(airframe.rotors)
        thrust = airframe.body.mass_kg * lift / upright
        thrust = max(_THRUST_MIN_RATIO * full_n, min(_THRUST_MAX_RATIO * full_n, thrust))
        self.lift_ratio = thrust * upright / airframe.hover_thrust_n
        motors, self._whole = self._mixer.outputs(thrust, moment)
        return ActuatorOutputs(motors)

    def reset(self) -> None:
        """Clears all integrals: the vehicle is disarmed or on the ground."""
        self._rate.reset()
        self._velocity.reset()
        self._climb.reset()
