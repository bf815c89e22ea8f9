"""Settings of the hardware abstraction (services/hal.toml)."""

from typing import Annotated, Any, TypeVar

import msgspec

from swarmware.model.config import convert

T = TypeVar("T", bound=msgspec.Struct)

Rate = Annotated[float, msgspec.Meta(gt=0, le=1000)]
RestRate = Annotated[float, msgspec.Meta(ge=5, le=1000)]
"""Rate at rest; `max_age_s` in the templates is three of its periods."""
Seconds = Annotated[float, msgspec.Meta(gt=0, le=3600)]


class SimDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `sim`: rates of the simulated devices."""

    gnss_hz: Rate = 10.0
    """Rate of the satellite navigation receiver."""
    imu_hz: Rate = 20.0
    """Rate of the inertial unit."""
    range_hz: Rate = 10.0
    """Rate of the range scanner."""
    sonar_hz: Rate = 20.0
    """Rate of the sonar; only on air vehicles."""
    rest_hz: RestRate = 5.0
    """No device of a vehicle that is disarmed and on the ground is read faster."""
    battery_hz: Rate = 1.0
    """Rate of the battery monitor."""
    sonar_window: Annotated[int, msgspec.Meta(ge=1, le=99)] = 5
    """Window of the median filter, in echoes (S2.49)."""


class ChassisConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The chassis of the vehicle, whichever driver reaches it."""

    drive: str = "act/drive"
    """Board of the set-points that the chassis follows."""
    rate_hz: Rate = 20.0
    """Rate at which set-points are carried to the chassis."""
    rest_hz: RestRate = 5.0
    """The same while the vehicle is disarmed and on the ground."""
    watchdog_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 0.5
    """Age of the newest set-point above which an armed vehicle is stopped; an air vehicle hovers."""
    answer_s: Annotated[float, msgspec.Meta(ge=0.1, le=60)] = 1.0
    """Time within which the chassis must answer an order."""


class SystemDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `system`: load of the computer."""

    rate_hz: Rate = 1.0
    """Rate of `system/load`."""


class ReplayDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `replay`: packets of a recording, at the rate of the device that sent them."""

    file: str = "vlp16/recording.bin"
    """Below share/swarm/data, or an absolute path."""
    packet_bytes: Annotated[int, msgspec.Meta(ge=1, le=65_000)] = 1206
    """Size of each packet of the recording."""
    packets_hz: Annotated[float, msgspec.Meta(gt=0, le=100_000)] = 753.0
    """A VLP-16 in strongest-return mode sends 753 to 754 packets a second."""
    path: str = "sensor/lidar"
    """Stream resource that gets the packets."""
    wake_hz: Rate = 20.0
    """Rate at which due packets are written, each stamped with its own instant."""
    slots: Annotated[int, msgspec.Meta(ge=16, le=100_000)] = 512
    """Size of the ring in packets: how far a slow reader may lag."""
    loop: bool = True
    """Whether the recording is repeated."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The drivers of the platform, and their parameters."""

    drivers: tuple[str, ...] = ("sim", "system")
    """Names of drivers: sim, system, replay, or those of installed packages."""
    retry_s: Seconds = 2.0
    """Pause before a device is opened again."""
    failures: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 10
    """Failed reads in a row after which the device is reopened."""
    report_hz: Rate = 1.0
    """Rate of `hal/drivers`."""
    chassis: ChassisConfig = ChassisConfig()
    sim: SimDriver = SimDriver()
    system: SystemDriver = SystemDriver()
    replay: ReplayDriver = ReplayDriver()
    plugins: dict[str, dict[str, Any]] = {}
    """Tables of settings for drivers of installed packages, by their names: `[plugins.NAME]`."""

    def plugin(self, name: str, cls: type[T]) -> T:
        """Settings of an installed driver: its table, or the defaults when there is none.

        Raises: ConfigError when the table does not fit its class.
        """
        return convert(self.plugins.get(name, {}), cls, f"services/hal.toml: table plugins.{name}")
