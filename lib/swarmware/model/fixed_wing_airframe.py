"""Settings of a fixed-wing aircraft: wing, stability derivatives, propeller (share/swarm/airframes)."""

import math
from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.body_config import BodyConfig, NotNegative, Positive, Rate

Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Angle = Annotated[float, msgspec.Meta(gt=0, le=1.6)]

AIR_DENSITY_KG_M3: Final = 1.225
"""At sea level: International Standard Atmosphere (ISO 2533)."""
_GRAVITY_M_S2: Final = 9.80665
_ATTACHED_RATIO: Final = 0.8
"""Angle of attack of the largest lift over that at which the flow separates, which is a transition."""
_STALL_MARGIN: Final = 1.15
"""Smallest ratio of the minimum airspeed to the stall speed: less leaves nothing for a gust or a turn."""


class WingConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Lift, drag and pitching moment of the aircraft, in the coefficients of its wing.

    Source: Beard and McLain 2012, "Small Unmanned Aircraft", chapter 4.
    """

    area_m2: Positive
    span_m: Positive
    chord_m: Positive
    """Mean chord."""
    oswald: Share = 0.9
    """Oswald's efficiency factor of the induced drag."""
    stall_rad: Angle
    """Angle of attack at which the flow separates, on both sides."""
    stall_sharpness_1_rad: Positive = 50.0
    """Sharpness of the transition to a flat plate."""
    lift_0: float
    """Lift at an angle of attack of 0."""
    lift_alpha: Positive
    """Lift by angle of attack, per radian."""
    lift_q: float
    """Lift by pitch rate."""
    lift_elevator: float
    drag_0: Share
    """Parasitic drag."""
    drag_elevator: float
    """Drag by the deflection of the elevator, in either direction."""
    moment_0: float
    """Pitching moment, nose up, at an angle of attack of 0."""
    moment_alpha: float
    """Pitching moment by angle of attack: negative is stable."""
    moment_q: float
    """Damping of pitch."""
    moment_elevator: float


class LateralConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Side force, roll and yaw moment: coefficients by side slip, rates and deflections.

    Signs of the source: right, right wing down, nose right.
    """

    side_beta: float
    side_p: float = 0.0
    side_r: float = 0.0
    side_aileron: float
    side_rudder: float
    roll_beta: float
    roll_p: float
    """Damping of roll."""
    roll_r: float
    roll_aileron: float
    roll_rudder: float
    yaw_beta: float
    """Weathercock stability: positive is stable."""
    yaw_p: float
    yaw_r: float
    """Damping of yaw."""
    yaw_aileron: float
    yaw_rudder: float


class PropellerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A propeller on an electric motor: coefficients of thrust and torque over the advance ratio.

    Source: McLain and Beard, supplement of "Small Unmanned Aircraft", section 4.3.
    """

    diameter_m: Positive
    thrust: tuple[float, float, float]
    """Thrust coefficient: constant, by advance ratio, by its square."""
    torque: tuple[float, float, float]
    """Torque coefficient in the same form."""
    voltage_max_v: Positive
    """Voltage of the motor at full throttle."""
    motor_constant_v_s: Positive
    """Voltage per angular speed, equal to torque per current."""
    resistance_ohm: Positive
    idle_current_a: NotNegative
    """Current without torque."""
    lag_s: Positive = 0.2
    """Time constant of the throttle."""


class SurfacesConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Control surfaces and their servos."""

    aileron_max_rad: Angle
    """Deflection with the servo at its end."""
    elevator_max_rad: Angle
    rudder_max_rad: Angle
    servo_s: Positive = 0.05
    """Time constant of a servo."""


class LauncherConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Catapult: accelerates the aircraft along its rail when the throttle is opened."""

    speed_m_s: Positive
    """Speed at the end of the rail."""
    rail_m: Positive
    """Length of the rail."""
    throttle_ratio: Share = 0.8
    """Throttle above which it releases the aircraft."""


class FixedWingGains(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Gains of the cascade of a fixed-wing aircraft.

    Gains of servos are valid at cruise airspeed; they fall with the square of the airspeed.
    """

    roll_kp: NotNegative
    """Aileron per radian of roll."""
    roll_ki_1_s: NotNegative
    """Integral gain: aileron rate per radian of roll."""
    roll_kd_s: NotNegative
    """Aileron per rad/s of roll rate."""
    pitch_kp: NotNegative
    """Elevator per radian of pitch."""
    pitch_ki_1_s: NotNegative
    """Integral gain: elevator rate per radian of pitch."""
    pitch_kd_s: NotNegative
    """Elevator per rad/s of pitch rate."""
    yaw_kd_s: NotNegative
    """Rudder per rad/s of the yaw rate in excess of the turn's own rate."""
    course_kp_1_s: NotNegative
    """Course loop: rate of turn per radian."""
    height_kp_1_s: NotNegative
    """Height loop: climb rate per metre from the commanded height, which is the integral of the set-point."""
    climb_kp_s_m: NotNegative
    """Climb loop: pitch per m/s, in rad."""
    climb_ki_1_m: NotNegative
    """Integral gain of the climb loop: pitch rate per m/s."""
    speed_kp_s_m: NotNegative
    """Airspeed loop: throttle per m/s."""
    speed_ki_1_m: NotNegative
    """Integral gain of the airspeed loop: throttle rate per m/s."""


class FixedWingLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the cascade of a fixed-wing aircraft."""

    airspeed_min_m_s: Positive
    """Minimum airspeed: the stall and a margin."""
    airspeed_cruise_m_s: Positive
    """Airspeed of a loiter, for which the gains are given."""
    airspeed_max_m_s: Positive
    """Maximum airspeed."""
    bank_max_rad: Angle = 0.7
    """Maximum bank."""
    pitch_max_rad: Angle = 0.35
    """Maximum pitch, up and down."""
    climb_max_m_s: Positive = 3.0
    """Maximum climb rate."""
    sink_max_m_s: Positive = 3.0
    """Maximum sink rate."""
    loiter_radius_m: Positive
    """Radius of the circle that it flies when it is to stop."""
    throttle_cruise_ratio: Share
    """Throttle in level flight at the airspeed of cruise."""
    throttle_climb_s_m: NotNegative
    """Additional throttle for each m/s of climb."""
    flare_m: Positive = 3.0
    """Height above the ground below which a descent is a landing: level wings, no throttle."""
    flare_sink_m_s: Positive = 0.5
    """Sink rate in the flare."""


class FixedWingAirframe(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A fixed-wing aircraft with one propeller, aileron, elevator and rudder, launched by a catapult."""

    type: Literal["fixed_wing"] = "fixed_wing"
    description: str
    control_hz: Rate = 100.0
    """Rate of the inertial unit and of the control loops."""
    battery_wh: Positive
    """Energy of a full battery."""
    body: BodyConfig
    wing: WingConfig
    lateral: LateralConfig
    propeller: PropellerConfig
    surfaces: SurfacesConfig
    launcher: LauncherConfig
    idle_w: NotNegative = 15.0
    """Power of the electronics."""
    gains: FixedWingGains
    limits: FixedWingLimits

    def __post_init__(self) -> None:
        """Checks that the airspeeds have a margin from the stall, and that the catapult reaches them.

        Raises: InvalidInput with the key and the expected value.
        """
        limits, stall = self.limits, self.stall_m_s
        if limits.airspeed_min_m_s < _STALL_MARGIN * stall:
            raise InvalidInput(
                f"key limits.airspeed_min_m_s: {limits.airspeed_min_m_s:g}, and it stalls at {stall:.1f} m/s;"
                f" expected at least {_STALL_MARGIN * stall:.1f}"
            )
        if not limits.airspeed_min_m_s <= limits.airspeed_cruise_m_s <= limits.airspeed_max_m_s:
            raise InvalidInput("key limits: expected airspeed_min_m_s, _cruise_ and _max_ in this order")
        if self.launcher.speed_m_s < stall:
            raise InvalidInput(
                f"key launcher.speed_m_s: {self.launcher.speed_m_s:g}; expected more than the stall at"
                f" {stall:.1f} m/s"
            )
        turn = math.atan(limits.airspeed_cruise_m_s**2 / (_GRAVITY_M_S2 * limits.loiter_radius_m))
        if turn > 0.8 * limits.bank_max_rad:
            raise InvalidInput(
                f"key limits.loiter_radius_m: {limits.loiter_radius_m:g} takes a bank of {turn:.2f} rad;"
                f" expected at most 0.8 of bank_max_rad ({0.8 * limits.bank_max_rad:.2f})"
            )

    @property
    def stall_m_s(self) -> float:
        """Airspeed of the stall in level flight."""
        lift = self.wing.lift_0 + self.wing.lift_alpha * self.wing.stall_rad * _ATTACHED_RATIO
        weight_n = self.body.mass_kg * _GRAVITY_M_S2
        return math.sqrt(2 * weight_n / (AIR_DENSITY_KG_M3 * self.wing.area_m2 * lift))
