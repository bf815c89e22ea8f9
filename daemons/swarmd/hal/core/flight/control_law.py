"""Interface of control laws: from a velocity set-point and the estimated state to actuators."""

from typing import Protocol

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint


class ControlLaw(Protocol):
    """Cascade of control loops of one type of airframe."""

    @property
    def gains(self) -> dict[str, float]:
        """Gains in force, by name."""
        ...

    def set_gains(self, gains: dict[str, float]) -> None:
        """Changes gains by name, also in flight (S2.46); others stay.

        Raises: Denied when a name is unknown, or a value out of range; none is changed then.
        """
        ...

    def update(self, wanted: Setpoint, state: FlightState, *, landed: bool, dt_s: float) -> ActuatorOutputs:
        """The outputs of this control step of an armed vehicle."""
        ...

    @property
    def acceleration_m_s2(self) -> float:
        """Horizontal acceleration that it commanded last."""
        ...

    def reset(self) -> None:
        """Clears all integrals: the vehicle is disarmed."""
        ...
