"""Airframes: mass, actuators and gains of vehicles, one file of share/swarm/airframes for each.

The simulation takes the mechanics from the file, the flight controller of the hardware abstraction the
geometry and the gains: a new airframe is a new file. `airframe` in node.toml names it.
"""

from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput

Positive = Annotated[float, msgspec.Meta(gt=0, le=1e6)]
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=1e6)]
Metres = Annotated[float, msgspec.Meta(ge=-100, le=100)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
Tilt = Annotated[float, msgspec.Meta(gt=0, le=1.0)]
Rate = Annotated[float, msgspec.Meta(ge=50, le=500)]

_MIN_ROTORS: Final = 4
"""Fewer cannot turn about three axes and climb."""
_HOVER_RESERVE: Final = 1.2
"""Minimum ratio of the maximum thrust to the weight: below it no attitude can be corrected in hover."""
_GRAVITY_M_S2: Final = 9.80665


class BodyConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The rigid body of an airframe."""

    mass_kg: Positive
    """Mass ready for take-off."""
    inertia_kg_m2: tuple[Positive, Positive, Positive]
    """Moments of inertia about the body axes forward, left and up, which are its principal axes."""
    radius_m: Positive
    """Radius of the sphere around the vehicle."""
    hard_landing_m_s: Positive = 1.5
    """Vertical speed at touch-down above which a landing is a collision."""
    drag_n_s_m: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Linear drag along the body axes: of the rotors."""
    drag_n_s2_m2: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Quadratic drag along the body axes: of the fuselage."""
    turn_drag_n_m_s: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Linear drag of a turn about the body axes."""


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


class MultirotorGains(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Gains and limits of the cascade of a multirotor.

    The rate loop commands angular accelerations and the velocity loop accelerations, so that gains depend on
    the lag of the motors and not on the mass.
    """

    rate_kp_1_s: NotNegative
    """Rate loop, roll and pitch: angular acceleration per rad/s."""
    rate_ki_1_s2: NotNegative
    """The same, integral."""
    yaw_rate_kp_1_s: NotNegative
    """Rate loop, yaw."""
    yaw_rate_ki_1_s2: NotNegative
    """The same, integral."""
    attitude_kp_1_s: NotNegative
    """Attitude loop: rate per radian of roll and pitch."""
    velocity_kp_1_s: NotNegative
    """Velocity loop: horizontal acceleration per m/s."""
    velocity_ki_1_s2: NotNegative
    """The same, integral: steady wind."""
    climb_kp_1_s: NotNegative
    """Vertical velocity: acceleration per m/s."""
    climb_ki_1_s2: NotNegative
    """The same, integral: weight and thrust that are not as configured."""
    height_kp_1_s: NotNegative
    """Height loop: climb rate per metre from the commanded height, which is the integral of the set-point."""


class CascadeLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the cascade of a multirotor."""

    tilt_max_rad: Tilt = 0.35
    """Maximum commanded angle from level."""
    velocity_max_m_s: Positive = 6.0
    """Maximum horizontal speed."""
    climb_max_m_s: Positive = 3.0
    """Maximum climb rate."""
    sink_max_m_s: Positive = 2.0
    """Maximum sink rate."""
    turn_max_rad_s: Positive = 1.5
    """Maximum yaw rate."""
    rate_max_rad_s: Positive = 3.0
    """Maximum commanded rate of roll and pitch."""


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
    gains: MultirotorGains
    limits: CascadeLimits = CascadeLimits()

    def __post_init__(self) -> None:
        """Checks that it can hover.

        Raises: InvalidInput with the key and what was expected.
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


Airframe = MultirotorAirframe
"""Each class describes one type of airframes."""

TYPES: Final[dict[str, type[Airframe]]] = {"multirotor": MultirotorAirframe}
"""The class of a file by its key `type`."""
