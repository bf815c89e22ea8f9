"""Settings of the simulation (services/sim.toml)."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0, le=1000)]
Sigma = Annotated[float, msgspec.Meta(ge=0, le=100)]
Power = Annotated[float, msgspec.Meta(ge=0, le=100_000)]
Rate = Annotated[float, msgspec.Meta(gt=0, le=1000)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]


class GroundLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the drive of a ground vehicle can do."""

    v_max_m_s: Positive = 3.0
    v_back_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.5
    """Greatest speed backwards."""
    a_max_m_s2: Positive = 2.0
    w_max_rad_s: Positive = 1.5
    dw_max_rad_s2: Positive = 3.0
    radius_m: Positive = 0.35
    """Of the circle that holds the vehicle."""
    power_w: Power = 15.0
    """Standing still."""
    power_per_m_s_w: Power = 40.0
    """More for each m/s."""


class SurfaceLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the propellers of a surface vessel can do, and how its hull answers."""

    v_max_m_s: Positive = 2.5
    v_back_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.5
    """Greatest speed backwards."""
    a_max_m_s2: Positive = 1.0
    tau_s: Positive = 0.6
    """Time constant of the speed's answer."""
    w_max_rad_s: Positive = 1.0
    w_tau_s: Positive = 0.4
    """Time constant of the yaw rate's answer (Nomoto's T)."""
    sway_tau_s: Positive = 0.3
    """How fast a slip to the side dies away."""
    radius_m: Positive = 0.45
    """Of the circle that holds the vessel."""
    power_w: Power = 12.0
    """Standing still."""
    power_per_m3_s3_w: Power = 20.0
    """More for each (m/s)³."""


class MultirotorLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a multirotor with its own attitude control answers velocity set-points."""

    v_max_m_s: Positive = 6.0
    """Horizontally."""
    climb_max_m_s: Positive = 3.0
    sink_max_m_s: Positive = 2.0
    a_max_m_s2: Positive = 4.0
    tau_s: Positive = 0.35
    """Time constant of the velocity's answer."""
    w_max_rad_s: Positive = 1.5
    w_tau_s: Positive = 0.2
    """Time constant of the yaw rate's answer."""
    radius_m: Positive = 0.3
    """Of the sphere that holds the vehicle."""
    hard_landing_m_s: Positive = 1.5
    """Touching the ground faster than this is a collision."""
    power_w: Power = 180.0
    """Hovering."""
    power_per_m_s_w: Power = 12.0


class Sensors(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rates and errors of the sensors; the defaults are those of an RTK receiver and a MEMS inertial unit."""

    gnss_hz: Rate = 10.0
    gnss_sigma_m: Sigma = 0.02
    """White noise, horizontally; the height has 1.5 times as much."""
    gnss_bias_sigma_m: Sigma = 0.03
    """A slow error that wanders with `gnss_bias_tau_s`."""
    gnss_bias_tau_s: Positive = 60.0
    imu_hz: Rate = 25.0
    gyro_sigma_rad_s: Sigma = 0.01
    accel_sigma_m_s2: Sigma = 0.08
    yaw_sigma_rad: Sigma = 0.005
    yaw_bias_sigma_rad: Sigma = 0.01
    """One throw at the start: how badly the compass was calibrated."""
    range_hz: Rate = 10.0
    range_beams: Annotated[int, msgspec.Meta(ge=4, le=1440)] = 72
    range_max_m: Positive = 10.0
    range_sigma_m: Sigma = 0.02
    sonar_hz: Rate = 20.0
    """Height above the ground, of vehicles that fly (S2.49)."""
    sonar_max_m: Positive = 6.45
    sonar_sigma_m: Sigma = 0.02
    sonar_outliers_ratio: Ratio = 0.02
    """Share of echoes that come from somewhere else."""


class Battery(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The accumulator."""

    capacity_wh: Positive = 120.0
    start_ratio: Ratio = 1.0
    voltage_full_v: Positive = 25.2
    voltage_empty_v: Positive = 19.8
    arm_ratio: Ratio = 0.15
    """Below this arming is refused."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is simulated, and how badly."""

    world: str = "formation"
    """A file of share/swarm/worlds without its ending."""
    number: Annotated[int, msgspec.Meta(ge=0, le=100_000)] = 0
    """Which of its kind it is in the world's start rule; 0: the number in the platform's name."""
    seed: int = 1
    """Of noise and start; every platform draws its own numbers from it."""
    rate_hz: Annotated[float, msgspec.Meta(ge=10, le=1000)] = 50.0
    setpoint_timeout_s: Positive = 0.5
    """Without a new set-point for this long the vehicle stops where it is."""
    contacts_hz: Rate = 10.0
    """How often the distance to the other platforms is looked at."""
    ground: GroundLimits = GroundLimits()
    surface: SurfaceLimits = SurfaceLimits()
    multirotor: MultirotorLimits = MultirotorLimits()
    sensors: Sensors = Sensors()
    battery: Battery = Battery()
