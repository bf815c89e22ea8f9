"""Airframes: mass, actuators and gains of vehicles, one file of share/swarm/airframes for each.

The simulation takes the mechanics from the file, the flight controller of the hardware abstraction the
geometry and the gains: a new airframe is a new file. `airframe` in node.toml names it.
"""

from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.body_config import BodyConfig, NotNegative, Positive, Rate
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.model.hover_gains import HoverGains, HoverLimits

Metres = Annotated[float, msgspec.Meta(ge=-100, le=100)]

_MIN_ROTORS: Final = 4
"""Fewer cannot turn about three axes and climb."""
_HOVER_RESERVE: Final = 1.2
"""Minimum ratio of the maximum thrust to the weight: below it no attitude can be corrected in hover."""
_GRAVITY_M_S2: Final = 9.80665


class RotorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Place and direction of one rotor, whose thrust is up."""

    x_m: Metres
    """Forward of the centre of mass."""
    y_m: Metres
    """Left of the centre of mass."""
    turns: Literal["cw", "ccw"]
    """Direction of rotation seen from above; the torque on the body is opposite."""

    @property
    def torque_sign(self) -> float:
        """Sign of the torque on the body about its axis up."""
        return 1.0 if self.turns == "cw" else -1.0


class MotorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One motor with its controller and propeller; all of an airframe are equal."""

    thrust_max_n: Positive
    """Thrust at the output 1; it is proportional to the square of the speed, and that to the output."""
    torque_ratio_m: Positive
    """Torque over thrust."""
    tau_s: Positive
    """Time constant of the speed."""
    hover_w: Positive
    """Electric power of all motors in hover; it rises with thrust^1.5 (momentum theory)."""
    idle_w: NotNegative
    """Power of the electronics."""


class MultirotorAirframe(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A multirotor: rotors that point up, at fixed pitch."""

    type: Literal["multirotor"] = "multirotor"
    description: str
    control_hz: Rate = 100.0
    """Rate of the inertial unit and of the control loops."""
    battery_wh: Positive
    """Energy of a full battery."""
    body: BodyConfig
    motor: MotorConfig
    rotors: tuple[RotorConfig, ...]
    gains: HoverGains
    limits: HoverLimits = HoverLimits()

    def __post_init__(self) -> None:
        """Checks that it can hover.

        Raises: InvalidInput with the key and the expected value.
        """
        if len(self.rotors) < _MIN_ROTORS:
            raise InvalidInput(f"key rotors: {len(self.rotors)} given; expected at least {_MIN_ROTORS}")
        weight_n = self.body.mass_kg * _GRAVITY_M_S2
        thrust_n = self.motor.thrust_max_n * len(self.rotors)
        if thrust_n < _HOVER_RESERVE * weight_n:
            raise InvalidInput(
                f"key motor.thrust_max_n: {len(self.rotors)} rotors give {thrust_n:.1f} N at a weight of"
                f" {weight_n:.1f} N; expected at least {_HOVER_RESERVE:g} times the weight"
            )
        both = {rotor.turns for rotor in self.rotors}
        if len(both) == 1:
            raise InvalidInput(
                f"key rotors: all turn {both.pop()}; expected cw and ccw, whose torques cancel"
            )
        for axis, arms in (("x_m", [r.x_m for r in self.rotors]), ("y_m", [r.y_m for r in self.rotors])):
            if not min(arms) < 0.0 < max(arms):
                raise InvalidInput(
                    f"key rotors: {axis} from {min(arms):g} to {max(arms):g};"
                    " expected rotors on both sides of the centre of mass"
                )

    @property
    def hover_thrust_n(self) -> float:
        """Thrust that carries the weight."""
        return self.body.mass_kg * _GRAVITY_M_S2


Airframe = MultirotorAirframe | HelicopterAirframe | FixedWingAirframe
"""Each class describes one type of airframes."""

TYPES: Final[dict[str, type[Airframe]]] = {
    "multirotor": MultirotorAirframe,
    "helicopter": HelicopterAirframe,
    "fixed_wing": FixedWingAirframe,
}
"""The class of a file by its key `type`."""
