"""Settings of the hardware abstraction (services/hal.toml)."""

from typing import Annotated

import msgspec

Rate = Annotated[float, msgspec.Meta(gt=0, le=1000)]
Seconds = Annotated[float, msgspec.Meta(gt=0, le=3600)]


class SimDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `sim`: how often each simulated device is read."""

    gnss_hz: Rate = 10.0
    imu_hz: Rate = 25.0
    range_hz: Rate = 10.0
    sonar_hz: Rate = 20.0
    """Only on platforms that fly."""
    battery_hz: Rate = 1.0
    sonar_window: Annotated[int, msgspec.Meta(ge=1, le=99)] = 5
    """Echoes of which the median counts (S2.49)."""


class SystemDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `system`: load of the computer."""

    rate_hz: Rate = 1.0


class ReplayDriver(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Driver `replay`: packets of a recording, at the rate of the device that sent them."""

    file: str = "vlp16/recording.bin"
    """Below share/swarm/data, or an absolute path."""
    packet_bytes: Annotated[int, msgspec.Meta(ge=1, le=65_000)] = 1206
    packets_hz: Annotated[float, msgspec.Meta(gt=0, le=100_000)] = 753.0
    """A VLP-16 in strongest-return mode sends 753 to 754 packets a second."""
    path: str = "sensor/lidar"
    wake_hz: Rate = 100.0
    """Packets that are due are written together this often, each with the stamp of its own instant."""
    slots: Annotated[int, msgspec.Meta(ge=16, le=100_000)] = 512
    """Packets that a slow reader may be behind."""
    loop: bool = True
    """Begin again at the end."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which drivers run, and how."""

    drivers: tuple[str, ...] = ("sim", "system")
    """Names of drivers: sim, system, replay, or those of installed packages."""
    retry_s: Seconds = 2.0
    """Pause after a device could not be opened or failed."""
    failures: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 10
    """Reads that may fail in a row before the device is closed and opened again."""
    report_hz: Rate = 1.0
    sim: SimDriver = SimDriver()
    system: SystemDriver = SystemDriver()
    replay: ReplayDriver = ReplayDriver()
