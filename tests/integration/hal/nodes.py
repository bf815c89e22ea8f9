"""Configurations of nodes whose HAL drives a vehicle."""

from pathlib import Path

from swarmd.hal.config import Config as HalConfig
from swarmd.hal.config import (
    CrsfDriver,
    MotorPulse,
    NmeaDriver,
    PwmFlightDriver,
    SonarDriver,
    VectorNavDriver,
)
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import SerialConfig
from swarmware.testing.tmpnode import make_node

DRIVERS = ("nmea", "vectornav", "sonar", "crsf", "serial_chassis")


def pulsed_node(root: Path) -> Path:
    """A quadrotor whose sensors are behind lines, and its motors behind pulses, in the folder `dev`."""
    lines = root / "dev"
    hal = HalConfig(
        drivers=(*DRIVERS[:-1], "pwm_flight"),
        retry_s=0.2,
        nmea=NmeaDriver(device=str(lines / "gnss")),
        vectornav=VectorNavDriver(device=str(lines / "imu"), path="sensor/imu_raw"),
        sonar=SonarDriver(device=str(lines / "sonar"), rate_hz=20.0, max_m=6.4),
        crsf=CrsfDriver(device=str(lines / "rc")),
        pwm_flight=PwmFlightDriver(
            device=str(lines / "pwmchip0"), motors=tuple(MotorPulse(channel=index) for index in range(4))
        ),
    )
    sim = SimConfig(serial=SerialConfig(folder=str(lines)))
    return make_node(root, services={"sim": sim, "hal": hal}, airframe="quad_1k5")


VEHICLE = ("sim", "hal", "control", "navigator")


def node(
    root: Path, platform: str, sim: SimConfig | None = None, hal: HalConfig | None = None, **settings: str
) -> Path:
    kind = platform.rstrip("0123456789")
    services = {"sim": sim or SimConfig(), "hal": hal or HalConfig()}
    return make_node(root, platform, kind=kind, services=services, **settings)
