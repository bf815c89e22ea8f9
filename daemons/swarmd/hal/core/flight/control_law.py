"""Interface of control laws: from a velocity set-point and the estimated state to actuators."""

from typing import Protocol, TypeVar

import msgspec

from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.errors import Denied
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint

G = TypeVar("G", bound=msgspec.Struct)


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
    def follows_nose(self) -> bool:
        """Whether the vehicle moves where its nose points, so that its turns are accelerations."""
        ...

    @property
    def acceleration_m_s2(self) -> float:
        """Horizontal acceleration that it commanded last."""
        ...

    @property
    def tilt_limit_rad(self) -> float:
        """Tilt that it never commands, beyond which the vehicle is out of control."""
        ...

    def expect_gap(self, gap_s: float) -> None:
        """Takes the time for which its outputs may be held: corrections must not grow too large in it."""
        ...

    def resume(self) -> None:
        """Continues after a gap: what it has learnt stays, commanded heights begin where the vehicle is."""
        ...

    def reset(self) -> None:
        """Clears all integrals: the vehicle is disarmed."""
        ...


class HoverLaw(ControlLaw, Protocol):
    """Control law of an airframe that hovers."""

    @property
    def lift_ratio(self) -> float:
        """Lift over the weight that it commanded last."""
        ...


def changed(gains: G, by_name: dict[str, float]) -> G:
    """The gains with some of them changed.

    Raises: Denied when a name is unknown, or a value out of range.
    """
    known = msgspec.structs.asdict(gains)
    for name in by_name:
        if name not in known:
            raise Denied(f"gain {name!r}: unknown to this airframe; expected one of {', '.join(known)}")
    try:
        return msgspec.convert({**known, **by_name}, type(gains))
    except msgspec.ValidationError as error:
        raise Denied(f"gains: {error}") from error
