"""Controller of a multirotor: the cascade of hovering vehicles above the mixer of the motors."""

from typing import Final

from swarmd.hal.core.flight.hover_controller import Demand, HoverController
from swarmd.hal.core.flight.mixer import IDLE, Mixer
from swarmware.model.airframe import MultirotorAirframe
from swarmware.types.chassis import ActuatorOutputs

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
