"""Settings of the navigator (services/navigator.toml)."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0, le=1000)]
Weight = Annotated[float, msgspec.Meta(ge=0, le=100)]
Rate = Annotated[float, msgspec.Meta(gt=0, le=200)]


class Estimator(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How position, velocity and heading are found."""

    accel_sigma_m_s2: Positive = 0.3
    """How wrong a measured acceleration may be: larger trusts the fixes more."""
    height_sigma_m: Positive = 0.05
    """Of the height above the ground by sonar."""
    yaw_tau_s: Positive = 1.0
    """Time in which the gyro's heading follows the compass."""
    gnss_timeout_s: Positive = 1.0
    """Without a fix for this long the position is lost, and the vehicle holds."""
    imu_timeout_s: Positive = 0.5
    rest_accel_m_s2: Positive = 0.4
    """A jolt: this far from its mean the specific force says that the vehicle moves."""
    rest_gyro_rad_s: Positive = 0.1
    """A turn: this fast the gyro says that the vehicle moves."""
    gnss_correlation_s: Positive = 60.0
    """Fixes closer in time share their errors: an average over less is hardly better than one of them."""


class Dwa(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Dynamic window planner of ground vehicles (S0, equations 4 and 5)."""

    v_max_m_s: Positive = 3.0
    v_back_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.3
    a_max_m_s2: Positive = 1.8
    w_max_rad_s: Positive = 1.4
    dw_max_rad_s2: Positive = 2.5
    window_s: Positive = 0.2
    """How far ahead the window of speeds reaches that the drive can attain."""
    horizon_s: Positive = 2.0
    """Length of the simulated trajectories."""
    steps: Annotated[int, msgspec.Meta(ge=2, le=100)] = 12
    v_samples: Annotated[int, msgspec.Meta(ge=2, le=100)] = 7
    w_samples: Annotated[int, msgspec.Meta(ge=3, le=200)] = 21
    heading_weight: Weight = 2.0
    """δ: towards the goal."""
    distance_weight: Weight = 1.0
    """β: away from obstacles."""
    velocity_weight: Weight = 1.0
    """γ: as fast as wanted."""
    heading_s: Positive = 0.5
    """Instant on the trajectory at which the heading is judged."""
    clear_m: Positive = 0.3
    """A distance from obstacles that is as good as any larger one."""
    radius_m: Positive = 0.35
    """Of the circle that holds the vehicle."""
    margin_m: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.2
    """Kept free besides."""


class Air(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Velocity control and avoidance of vehicles that fly."""

    v_max_m_s: Positive = 5.0
    climb_max_m_s: Positive = 2.0
    sink_max_m_s: Positive = 1.5
    a_max_m_s2: Positive = 2.0
    """Used for braking on the way to a place."""
    kp_1_s: Positive = 1.0
    """Metres per second for each metre away."""
    yaw_kp_1_s: Positive = 1.0
    w_max_rad_s: Positive = 1.0
    separation_m: Positive = 1.5
    """Between the middles of two platforms."""
    obstacle_m: Positive = 0.9
    """Between the middle of the vehicle and an obstacle."""
    horizon_s: Positive = 3.0
    """Meetings that lie further ahead wait."""
    touch_down_m_s: Positive = 0.5
    """Sinking speed close to the ground."""


class Altitude(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """PID altitude hold: from metres of height to metres per second of climb."""

    kp_1_s: Weight = 1.2
    ki_1_s2: Weight = 0.15
    kd: Weight = 0.1


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the vehicle finds its way."""

    world: str = "formation"
    """A file of share/swarm/worlds without its ending: gives the origin of the map."""
    rate_hz: Rate = 20.0
    """Of pose and set-point."""
    plan_hz: Rate = 10.0
    """Of the dynamic window planner."""
    status_hz: Rate = 5.0
    """Of `nav/status`, besides each change of its state."""
    look_ahead_s: Positive = 1.2
    """A ground vehicle aims at the point where its place will be after this time."""
    look_ahead_min_m: Positive = 1.5
    along_kp_1_s: Positive = 0.8
    """Metres per second for each metre that a ground vehicle is behind its place."""
    course_accel_m_s2: Positive = 0.5
    """How softly the leader starts and stops."""
    leader_timeout_s: Positive = 2.0
    """Without the leader's pose for this long the vehicle holds."""
    neighbour_timeout_s: Positive = 2.0
    """A platform not heard for this long is not avoided any more."""
    arrive_m: Positive = 0.3
    """This close to the goal is there."""
    formation_arrive_m: Positive = 0.5
    """This close to its slot a member of a formation has taken it."""
    blocked_s: Positive = 5.0
    """No progress for this long is being blocked."""
    estimator: Estimator = Estimator()
    dwa: Dwa = Dwa()
    air: Air = Air()
    altitude: Altitude = Altitude()
