"""Settings of the simulation (services/sim.toml)."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0, le=1000)]
Sigma = Annotated[float, msgspec.Meta(ge=0, le=100)]
Speed = Annotated[float, msgspec.Meta(ge=-100, le=100)]
Power = Annotated[float, msgspec.Meta(ge=0, le=100_000)]
Rate = Annotated[float, msgspec.Meta(gt=0, le=1000)]
RestRate = Annotated[float, msgspec.Meta(ge=5, le=1000)]
"""Rate at rest, from 5 Hz on, because `max_age_s` in the templates is three periods of 5 Hz."""
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]


class GroundLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the drive of a ground vehicle."""

    v_max_m_s: Positive = 3.0
    """Maximum speed."""
    v_back_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.5
    """Maximum backward speed."""
    a_max_m_s2: Positive = 2.0
    """Maximum acceleration."""
    w_max_rad_s: Positive = 1.5
    """Maximum yaw rate."""
    dw_max_rad_s2: Positive = 3.0
    """Maximum yaw acceleration."""
    radius_m: Positive = 0.35
    """Radius of the circle around the vehicle."""
    power_w: Power = 15.0
    """Electric power of a vehicle at rest, in W."""
    power_per_m_s_w: Power = 40.0
    """Electric power in addition to the power at rest, in W per m/s of speed."""


class SurfaceLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the propulsion of a surface vessel, and the dynamics of its hull."""

    v_max_m_s: Positive = 2.5
    """Maximum speed."""
    v_back_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.5
    """Maximum backward speed."""
    a_max_m_s2: Positive = 1.0
    """Maximum acceleration."""
    tau_s: Positive = 0.6
    """Time constant of the speed."""
    w_max_rad_s: Positive = 1.0
    """Maximum yaw rate."""
    w_tau_s: Positive = 0.4
    """Time constant of the yaw rate (Nomoto's T)."""
    sway_tau_s: Positive = 0.3
    """Time constant of the decay of sway."""
    current_m_s: tuple[Speed, Speed] = (0.0, 0.0)
    """Current of the water to the east and the north, which carries the vessel even at rest."""
    radius_m: Positive = 0.45
    """Radius of the circle around the vessel."""
    power_w: Power = 12.0
    """Electric power of a vehicle at rest, in W."""
    power_per_m3_s3_w: Power = 20.0
    """Electric power in addition to the power at rest, in W per (m/s)³ of speed."""


class MultirotorLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Closed-loop dynamics of a multirotor that follows velocity set-points with its own attitude control."""

    v_max_m_s: Positive = 6.0
    """Maximum horizontal speed."""
    climb_max_m_s: Positive = 3.0
    """Maximum climb rate."""
    sink_max_m_s: Positive = 2.0
    """Maximum sink rate."""
    a_max_m_s2: Positive = 4.0
    """Maximum acceleration."""
    tau_s: Positive = 0.35
    """Time constant of the velocity."""
    w_max_rad_s: Positive = 1.5
    """Maximum yaw rate."""
    w_tau_s: Positive = 0.2
    """Time constant of the yaw rate."""
    radius_m: Positive = 0.3
    """Radius of the sphere around the vehicle."""
    hard_landing_m_s: Positive = 1.5
    """Vertical speed at touch-down above which a landing is a collision."""
    power_w: Power = 180.0
    """Electric power in hover, in W."""
    power_per_m_s_w: Power = 12.0
    """Electric power in addition to the power in hover, in W per m/s of speed."""


class SensorsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rates and errors of the sensors; the defaults describe an RTK receiver and a MEMS inertial unit."""

    gnss_hz: Rate = 10.0
    """Rate of the satellite fixes."""
    gnss_sigma_m: Sigma = 0.02
    """White noise of the horizontal position; the noise of the height is 1.5 times as large."""
    gnss_bias_sigma_m: Sigma = 0.03
    """Standard deviation of the position's bias, a first-order Gauss-Markov process with
    `gnss_bias_tau_s`."""
    gnss_bias_tau_s: Positive = 60.0
    """Correlation time of the bias of the position."""
    imu_hz: Rate = 20.0
    """Rate of the inertial unit, equal to the navigator's rate so that samples and reads coincide."""
    gyro_sigma_rad_s: Sigma = 0.01
    """White noise of the yaw rate."""
    accel_sigma_m_s2: Sigma = 0.08
    """White noise of the acceleration."""
    yaw_sigma_rad: Sigma = 0.005
    """White noise of the compass."""
    yaw_bias_sigma_rad: Sigma = 0.01
    """Calibration error of the compass, drawn once at the start."""
    range_hz: Rate = 10.0
    """Rate of the range scanner."""
    range_beams: Annotated[int, msgspec.Meta(ge=4, le=1440)] = 72
    """Number of beams of a scan, evenly distributed around the vehicle."""
    range_max_m: Positive = 10.0
    """Maximum range of the scanner."""
    range_sigma_m: Sigma = 0.02
    """White noise of a range."""
    sonar_hz: Rate = 20.0
    """Rate of the sonar of air vehicles, which measures the height above the ground (S2.49)."""
    rest_hz: RestRate = 5.0
    """Maximum rate of all sensors while the vehicle is disarmed and on the ground."""
    sonar_max_m: Positive = 6.45
    """Maximum range of the sonar."""
    sonar_sigma_m: Sigma = 0.02
    """White noise of an echo."""
    sonar_outliers_ratio: Ratio = 0.02
    """Ratio of outliers among the echoes."""


class WindConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Wind at a vehicle with an airframe; vehicles without an airframe are not affected."""

    mean_m_s: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    """Mean velocity of the air to the east, to the north and up."""
    gust_sigma_m_s: Sigma = 0.0
    """Standard deviation of the gusts along each axis."""
    gust_tau_s: Positive = 2.0
    """Correlation time of the gusts."""


class BatteryConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Capacity and voltages of the battery."""

    capacity_wh: Positive = 120.0
    """Energy of a full battery, in Wh."""
    start_ratio: Ratio = 1.0
    """State of charge at the start."""
    voltage_full_v: Positive = 25.2
    """Voltage of a full battery."""
    voltage_empty_v: Positive = 19.8
    """Voltage of an empty battery."""
    arm_ratio: Ratio = 0.15
    """State of charge below which arming is refused."""


class SerialConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Serial lines of the vehicle's devices, for which the drivers of a real vehicle can be used."""

    folder: str = ""
    """Folder in which the lines appear as files gnss, imu, sonar, rc and chassis, or "" for no lines.

    With an airframe, motors and servos follow the pulses of `pwmchip0` in this folder, and there is no
    chassis."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the simulated world, vehicle and sensors."""

    world: str = "formation"
    """Name of a file of share/swarm/worlds, without its suffix."""
    number: Annotated[int, msgspec.Meta(ge=0, le=100_000)] = 0
    """Index of the vehicle in the start rule of the world, or 0 for the number in the platform's name."""
    seed: int = 1
    """Seed of noise and start position, combined with the platform's name."""
    rate_hz: Annotated[float, msgspec.Meta(ge=10, le=1000)] = 40.0
    """Rate of the integration steps, a multiple of the rates of the sensors."""
    setpoint_timeout_s: Positive = 0.5
    """Time without a new set-point after which the vehicle stops."""
    contacts_hz: Rate = 10.0
    """Rate of the collision check against other platforms."""
    ground: GroundLimits = GroundLimits()
    surface: SurfaceLimits = SurfaceLimits()
    multirotor: MultirotorLimits = MultirotorLimits()
    sensors: SensorsConfig = SensorsConfig()
    wind: WindConfig = WindConfig()
    battery: BatteryConfig = BatteryConfig()
    serial: SerialConfig = SerialConfig()
