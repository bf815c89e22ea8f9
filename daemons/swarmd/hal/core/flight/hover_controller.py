"""Cascade of vehicles that hover: velocity, climb, attitude and rate loop above an airframe's actuators."""

import math
from abc import ABC, abstractmethod
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
from swarmware.model.hover_gains import HoverGains, HoverLimits
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint

_LIFT_M_S: Final = 0.1
"""Commanded climb rate above which a landed vehicle takes off."""
_TILT_MIN: Final = 0.5
"""Smallest cosine of the tilt by which thrust is increased to keep the height."""


class Demand(msgspec.Struct, frozen=True, gc=False):
    """What the loops demand of the actuators in one step."""

    lift_m_s2: float
    """Acceleration upward that the vehicle needs, with gravity."""
    upright: float
    """Cosine of the tilt: the share of the thrust that lifts."""
    rates_rad_s: Vector
    """Rates about the body axes."""
    turn: Vector
    """Moment about the body axes, in N m; by an inertia of 1 the angular acceleration."""


class HoverController(ABC):
    """Control law of an airframe that hovers; how its actuators produce a demand is the airframe's."""

    follows_nose: Final = False

    def __init__(
        self, gains: HoverGains, limits: HoverLimits, inertia_kg_m2: Vector, ground: ActuatorOutputs
    ) -> None:
        """`ground`: outputs of an armed vehicle that stays on the ground."""
        self._gains = gains
        self._limits = limits
        self._ground = ground
        self._rate = RateLoop(inertia_kg_m2)
        self._velocity = VelocityLoop()
        self._climb = ClimbLoop()
        self._whole = True
        """Whether the actuators produced all that was demanded last."""
        self.lift_ratio = 0.0
        """Lift over the weight that it commanded last."""

    @abstractmethod
    def _actuated(self, demand: Demand) -> tuple[ActuatorOutputs, float, bool]:
        """Outputs, lift over the weight, and whether all of the demand is produced."""

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
                return self._ground
        gains, limits = self._gains, self._limits
        roll, pitch = self._velocity.tilt_rad(gains, limits, (wanted.vx_m_s, wanted.vy_m_s), state, dt_s)
        climb = self._climb.acceleration_m_s2(gains, limits, wanted.vz_m_s, state, dt_s)
        yaw_rate = max(-limits.turn_max_rad_s, min(limits.turn_max_rad_s, wanted.wz_rad_s))
        rates = body_rates(state, roll, pitch, yaw_rate, gains.attitude_kp_1_s, limits.rate_max_rad_s)
        turn = self._rate.moment_n_m(gains, rates, state.rates_rad_s, dt_s, learns=self._whole)
        upright = max(_TILT_MIN, math.cos(state.roll_rad) * math.cos(state.pitch_rad))
        demand = Demand(GRAVITY_M_S2 + climb, upright, rates, turn)
        outputs, self.lift_ratio, self._whole = self._actuated(demand)
        return outputs

    def reset(self) -> None:
        """Clears all integrals: the vehicle is disarmed or on the ground."""
        self._rate.reset()
        self._velocity.reset()
        self._climb.reset()
