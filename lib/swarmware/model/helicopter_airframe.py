"""Settings of a helicopter: rotor, hover derivatives and fuselage (share/swarm/airframes)."""

import math
from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.body_config import BodyConfig, NotNegative, Positive, Rate
from swarmware.model.hover_gains import HoverGains, HoverLimits

Share = Annotated[float, msgspec.Meta(ge=0, le=1)]

AIR_DENSITY_KG_M3: Final = 1.225
"""At sea level: International Standard Atmosphere (ISO 2533)."""
_GRAVITY_M_S2: Final = 9.80665
_AXES_MIN: Final = 0.1
"""Difference of the products of the cyclic controls over their sum, below which both tilt the same way."""
_HOVER_COLLECTIVE_MAX: Final = 0.6
"""Largest collective in hover: the rest is for climb and gusts."""


class MainRotorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Main rotor: blade-element and momentum theory give its thrust and power."""

    radius_m: Positive
    """Radius of the disc."""
    tip_speed_m_s: Positive
    """Speed of the blade tips, which a governor keeps."""
    solidity: Annotated[float, msgspec.Meta(gt=0, le=1)]
    """Ratio of the blades' area to the disc's area."""
    lift_slope_1_rad: Positive = 5.7
    """Lift slope of a blade section."""
    drag_coefficient: Share = 0.012
    """Profile drag of a blade section."""
    collective_mid_rad: Annotated[float, msgspec.Meta(ge=-0.5, le=0.5)]
    """Blade pitch with the collective servo at 0."""
    collective_span_rad: Annotated[float, msgspec.Meta(gt=0, le=0.5)]
    """Change of the blade pitch from the centre of the servo to its end."""
    thrust_coefficient_max: Annotated[float, msgspec.Meta(gt=0, le=0.1)] = 0.0055
    """Thrust over ρ A (ΩR)² at which the blades stall."""
    hub_height_m: Positive = 0.5
    """Height of the disc above the ground of a landed vehicle (ground effect)."""
    spool_s: Positive = 1.0
    """Time constant of the rotor's speed when the motor is switched on or off."""


class HoverDerivatives(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Linear hover model with flapping, in body axes forward, right, down, as it is identified from flights.

    Units: SI and radians; controls from -1 to 1. Signs of the source: a lateral control of 1 rolls to the
    right, a longitudinal one pitches the nose down, a pedal of 1 yaws to the right.
    Source: Mettler, Tischler, Kanade 1999, "System identification of small-size unmanned helicopter
    dynamics", 55th Forum of the American Helicopter Society.
    """

    x_u: float
    """Drag of the rotor forward: 1/s."""
    y_v: float
    """Drag of the rotor sideward: 1/s."""
    l_u: float
    """Roll acceleration by forward speed: rad/s² per m/s."""
    l_v: float
    """Roll acceleration by sideward speed: rad/s² per m/s."""
    l_b: Positive
    """Roll acceleration by lateral flapping: 1/s²."""
    m_u: float
    """Pitch acceleration by forward speed: rad/s² per m/s."""
    m_v: float
    """Pitch acceleration by sideward speed: rad/s² per m/s."""
    m_a: Positive
    """Pitch acceleration by longitudinal flapping: 1/s²."""
    tau_f_s: Positive
    """Time constant of flapping."""
    a_b: float
    """Longitudinal flapping by lateral flapping."""
    b_a: float
    """Lateral flapping by longitudinal flapping."""
    a_lat: float
    """Longitudinal flapping by lateral control: rad."""
    a_lon: float
    """Longitudinal flapping by longitudinal control: rad."""
    b_lat: float
    """Lateral flapping by lateral control: rad."""
    b_lon: float
    """Lateral flapping by longitudinal control: rad."""
    n_p: float
    """Yaw acceleration by roll rate: 1/s."""
    n_v: float
    """Yaw acceleration by sideward speed: rad/s² per m/s."""
    n_w: float
    """Yaw acceleration by sink rate: rad/s² per m/s."""
    n_r: float
    """Yaw damping: 1/s."""
    n_ped: Positive
    """Yaw acceleration by pedal: rad/s²."""
    n_col: float
    """Yaw acceleration by collective: rad/s²."""
    k_r: float
    """Gyro of the tail rotor: growth of its pedal by yaw rate, 1/rad."""
    k_rfb: float
    """Gyro of the tail rotor: decay of its pedal, 1/s."""


class HelicopterAirframe(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A helicopter with a main and a tail rotor; the body has the drag of its fuselage."""

    type: Literal["helicopter"] = "helicopter"
    description: str
    control_hz: Rate = 100.0
    """Rate of the inertial unit and of the control loops."""
    battery_wh: Positive
    """Energy of a full battery."""
    body: BodyConfig
    rotor: MainRotorConfig
    derivatives: HoverDerivatives
    servo_s: Positive = 0.02
    """Time constant of the servos."""
    efficiency_ratio: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.7
    """Ratio of the main rotor's power to the battery's, after motor, gears and tail rotor."""
    idle_w: NotNegative = 20.0
    """Power of the electronics."""
    gains: HoverGains
    limits: HoverLimits = HoverLimits()

    def __post_init__(self) -> None:
        """Checks that it can hover, and that the cyclic controls tilt the disc about both axes.

        Raises: InvalidInput with the key and the expected value.
        """
        hover = self.collective(self.body.mass_kg * _GRAVITY_M_S2)
        if not -1.0 < hover < _HOVER_COLLECTIVE_MAX:
            raise InvalidInput(
                f"key rotor: the collective in hover is {hover:.2f}; expected -1 to"
                f" {_HOVER_COLLECTIVE_MAX:g}: mass, radius, tip speed and solidity do not fit"
            )
        of = self.derivatives
        one, other = of.a_lon * of.b_lat, of.a_lat * of.b_lon
        if abs(one - other) < _AXES_MIN * (abs(one) + abs(other)):
            raise InvalidInput(
                "key derivatives: a_lon b_lat and a_lat b_lon are nearly equal; expected controls about"
                " two axes"
            )

    def collective(self, thrust_n: float) -> float:
        """Collective control from -1 to 1 for a thrust in still air, by momentum theory."""
        rotor = self.rotor
        pressure = AIR_DENSITY_KG_M3 * math.pi * rotor.radius_m**2 * rotor.tip_speed_m_s**2
        coefficient = max(thrust_n, 0.0) / pressure
        pitch = 6 * coefficient / (rotor.lift_slope_1_rad * rotor.solidity) + 1.5 * math.sqrt(coefficient / 2)
        return (pitch - rotor.collective_mid_rad) / rotor.collective_span_rad
