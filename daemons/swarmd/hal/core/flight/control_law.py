"""Interface of control laws, which compute actuator outputs from set-point and estimated state."""

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
        """Changes gains by name, also in flight (S2.46); other gains stay.

        Raises: Denied when a name is unknown or a value out of range; no gain is changed then.
        """
        ...

    def update(self, wanted: Setpoint, state: FlightState, *, landed: bool, dt_s: float) -> ActuatorOutputs:
        """Computes the outputs of one control step of an armed vehicle."""
        ...

    @property
    def follows_nose(self) -> bool:
        """True if the vehicle moves where its nose points, so that its turns are accelerations."""
        ...

    @property
    def acceleration_m_s2(self) -> float:
        """Horizontal acceleration of the last command."""
        ...

    @property
    def tilt_limit_rad(self) -> float:
        """Tilt above all commanded tilts, beyond which the vehicle counts as out of control."""
        ...

    def expect_gap(self, gap_s: float) -> None:
        """Takes the time for which outputs may be held, and limits gains so that held corrections stay
        stable."""
        ...

    def resume(self) -> None:
        """Continues after a gap; integrals stay, and the commanded height begins at the vehicle's height."""
        ...

    def reset(self) -> None:
        """Clears all integrals when the vehicle is disarmed."""
        ...


class HoverLaw(ControlLaw, Protocol):
    """Control law of an airframe that can hover."""

    @property
    def lift_ratio(self) -> float:
        """Ratio of the last commanded lift to the weight."""
        ...


def changed(gains: G, by_name: dict[str, float]) -> G:
    """Copies gains, with some of them changed.

    Raises: Denied when a name is unknown, or a value out of range.
    """
    known = msgspec.structs.asdict(gains)
    for name in by_name:
        if name not in known:
            raise Denied(f"gain {name!r}: unknown to this airframe; expected one of {', '.join(known)}")
    try:
        # converted as a whole, so that an invalid value changes no gain
        return msgspec.convert({**known, **by_name}, type(gains))
    except msgspec.ValidationError as error:
        raise Denied(f"gains: {error}") from error
