"""Settings of the navigator (services/navigator.toml)."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0, le=1000)]
Weight = Annotated[float, msgspec.Meta(ge=0, le=100)]
Rate = Annotated[float, msgspec.Meta(gt=0, le=200)]


class EstimatorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the state estimation: position, velocity, heading."""

    accel_sigma_m_s2: Positive = 0.3
    """Standard deviation of a measured acceleration; a larger value gives the fixes more weight."""
    height_sigma_m: Positive = 0.05
    """Standard deviation of the height above the ground from the sonar."""
    yaw_tau_s: Positive = 1.0
    """Time constant of the correction of the gyro's heading by the compass."""
    gnss_timeout_s: Positive = 1.0
    """Time without a fix after which the position is invalid and the vehicle holds."""
    imu_timeout_s: Positive = 0.5
    """Time without inertial measurements after which the estimate is invalid."""
    rest_accel_m_s2: Positive = 0.4
    """Deviation of the specific force from its mean above which the vehicle counts as moving."""
    rest_gyro_rad_s: Positive = 0.1
    """Rate of turn above which the vehicle counts as moving."""
    gnss_correlation_s: Positive = 60.0
    """Correlation time of the errors of fixes; an average over a shorter time is hardly better than one
    fix."""


class DwaConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Dynamic window planner of ground vehicles (S0, equations 4 and 5)."""

    v_max_m_s: Positive = 3.0
    """Maximum speed."""
    v_back_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.3
    """Maximum backward speed."""
    a_max_m_s2: Positive = 1.8
    """Maximum acceleration."""
    w_max_rad_s: Positive = 1.4
    """Maximum yaw rate."""
    dw_max_rad_s2: Positive = 2.5
    """Maximum yaw acceleration."""
    window_s: Positive = 0.2
    """Time in which the drive attains every speed of the dynamic window."""
    horizon_s: Positive = 2.0
    """Duration of the simulated trajectories."""
    steps: Annotated[int, msgspec.Meta(ge=2, le=100)] = 12
    """Number of steps of each simulated trajectory."""
    v_samples: Annotated[int, msgspec.Meta(ge=2, le=100)] = 7
    """Number of samples of the speed."""
    w_samples: Annotated[int, msgspec.Meta(ge=3, le=200)] = 21
    """Number of samples of the yaw rate."""
    heading_weight: Weight = 2.0
    """Weight δ of the heading towards the goal."""
    distance_weight: Weight = 1.0
    """Weight β of the distance from obstacles."""
    velocity_weight: Weight = 1.0
    """Weight γ of the commanded speed."""
    heading_s: Positive = 0.5
    """Instant on the trajectory at which the heading is evaluated."""
    clear_m: Positive = 0.3
    """Distance from obstacles above which the distance term is saturated."""
    radius_m: Positive = 0.35
    """Radius of the circle around the vehicle."""
    margin_m: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.2
    """Clearance that is kept in addition to the radius."""


class AirConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Velocity control and collision avoidance of air vehicles."""

    v_max_m_s: Positive = 5.0
    """Maximum horizontal speed."""
    climb_max_m_s: Positive = 2.0
    """Maximum climb rate."""
    sink_max_m_s: Positive = 1.5
    """Maximum sink rate."""
    a_max_m_s2: Positive = 2.0
    """Deceleration when braking at the target."""
    kp_1_s: Positive = 1.0
    """Position gain, in m/s per metre of distance."""
    yaw_kp_1_s: Positive = 1.0
    """Heading gain, in rad/s per radian of error."""
    w_max_rad_s: Positive = 1.0
    """Maximum yaw rate."""
    separation_m: Positive = 1.5
    """Minimum distance between the centres of two platforms."""
    obstacle_m: Positive = 0.9
    """Minimum distance between the centre of the vehicle and an obstacle."""
    horizon_s: Positive = 3.0
    """Time horizon of the avoidance; later collisions are ignored."""
    touch_down_m_s: Positive = 0.5
    """Descent rate close to the ground."""


class AltitudeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Gains of the PID altitude hold, from height error in m to climb rate in m/s."""

    kp_1_s: Weight = 1.2
    """Proportional gain, in climb rate per metre of height error."""
    ki_1_s2: Weight = 0.15
    """Integral gain."""
    kd: Weight = 0.1
    """Derivative gain, which damps the climb rate."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the navigation of one vehicle."""

    world: str = "formation"
    """Name of a file of share/swarm/worlds without its suffix, which defines the origin of the map."""
    rate_hz: Rate = 20.0
    """Rate of poses and set-points."""
    rest_hz: Annotated[float, msgspec.Meta(ge=5, le=200)] = 5.0
    """Rate of poses and set-points while disarmed and on the ground; `max_age_s` of both is three periods."""
    plan_hz: Rate = 10.0
    """Rate of the dynamic window planner."""
    status_hz: Rate = 5.0
    """Rate of an unchanged `nav/status`; a change of state is published at once."""
    look_ahead_s: Positive = 1.2
    """Look-ahead time of a ground vehicle on the path of its slot."""
    look_ahead_min_m: Positive = 1.5
    """Minimum look-ahead distance of a ground vehicle."""
    along_kp_1_s: Positive = 0.8
    """Along-track gain of a ground vehicle, in m/s per metre behind its slot."""
    course_accel_m_s2: Positive = 0.5
    """Acceleration of the leader along the course."""
    leader_timeout_s: Positive = 2.0
    """Time without the leader's pose after which the vehicle holds."""
    pose_timeout_s: Positive = 0.6
    """Time without the pose of an estimator on another computer after which the vehicle stops."""
    neighbour_timeout_s: Positive = 2.0
    """Time without the pose of a platform after which the platform is not avoided any more."""
    arrive_m: Positive = 0.3
    """Distance from the goal at which the vehicle has arrived."""
    formation_arrive_m: Positive = 0.5
    """Distance from its slot at which a member of a formation has arrived."""
    blocked_s: Positive = 5.0
    """Time without progress after which the vehicle is blocked."""
    estimator: EstimatorConfig = EstimatorConfig()
    dwa: DwaConfig = DwaConfig()
    air: AirConfig = AirConfig()
    altitude: AltitudeConfig = AltitudeConfig()

    def period_s(self, *, resting: bool) -> float:
        """Time between two steps, which is longer for a vehicle that is disarmed and on the ground."""
        return 1 / (min(self.rate_hz, self.rest_hz) if resting else self.rate_hz)
