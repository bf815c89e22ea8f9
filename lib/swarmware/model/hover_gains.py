"""Gains and limits of vehicles that hover: multirotors and helicopters have the same cascade."""

from typing import Annotated

import msgspec

from swarmware.model.body_config import NotNegative, Positive

Tilt = Annotated[float, msgspec.Meta(gt=0, le=1.0)]


class HoverGains(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Gains and limits of the cascade of a vehicle that hovers.

    The rate loop commands angular accelerations and the velocity loop accelerations, so that gains depend on
    the lag of the actuators and not on the mass.
    """

    rate_kp_1_s: NotNegative
    """Rate loop, roll and pitch: angular acceleration per rad/s."""
    rate_ki_1_s2: NotNegative
    """Integral gain of the rate loop of roll and pitch."""
    yaw_rate_kp_1_s: NotNegative
    """Rate loop, yaw."""
    yaw_rate_ki_1_s2: NotNegative
    """Integral gain of the yaw rate loop."""
    attitude_kp_1_s: NotNegative
    """Attitude loop: rate per radian of roll and pitch."""
    velocity_kp_1_s: NotNegative
    """Velocity loop: horizontal acceleration per m/s."""
    velocity_ki_1_s2: NotNegative
    """Integral gain of the velocity loop, against steady wind."""
    climb_kp_1_s: NotNegative
    """Vertical velocity: acceleration per m/s."""
    climb_ki_1_s2: NotNegative
    """Integral gain of the climb loop, against errors of the configured weight and thrust."""
    height_kp_1_s: NotNegative
    """Height loop: climb rate per metre from the commanded height, which is the integral of the set-point."""


class HoverLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the cascade of a vehicle that hovers."""

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
