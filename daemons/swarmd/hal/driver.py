"""The interfaces of drivers: sensors bring measurements in, actuators carry set-points out."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import msgspec

from swarmd.hal.config import Config
from swarmd.hal.core.condition import Condition
from swarmd.hal.core.line_load import LineUse
from swarmware.errors import SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module

if TYPE_CHECKING:
    from swarmware.model.airframe import Airframe


class DeviceError(SwarmError):
    """The device is missing, or gave an invalid answer."""


class DeviceGone(DeviceError):
    """The device was unplugged: it is opened again without further calls."""


class Device(ABC):
    """One device behind its driver: opened, served once per period, closed.

    Each method may raise DeviceError or OSError: after some of them in a row, or at once after a
    DeviceGone, the device is closed and opened again.
    """

    name: str
    """Unique on the platform: `system`, `sim.gnss`."""
    period_s: float
    """Period of the driver, matched to the update rate of the device (S2.5); each call may change it."""
    line_uses: tuple[LineUse, ...] = ()
    """What it asks of lines and buses (S1.17)."""

    async def open(self, module: Module) -> None:  # noqa: B027  # some devices need no opening
        """Opens the device and the writers of its resources."""

    async def close(self) -> None:  # noqa: B027  # some devices need no closing
        """Closes the device and its writers."""


class Sensor(Device):
    """Input half: the driver of a device that measures."""

    @abstractmethod
    async def read(self, now_ns: int) -> bool:
        """Reads the device and publishes its values; False when it had no new ones."""

    def stalled(self, now_ns: int) -> str:
        """Reason why the device answers, but nothing it says is a measurement; else empty."""
        return ""


Driver = Sensor
"""Name of a sensor's driver in packages that were written for version 0.1."""


class Actuator(Device):
    """Output half: the driver of a device that acts, with a watchdog of its own."""

    @abstractmethod
    async def write(self, now_ns: int) -> bool:
        """Carries the newest set-point to the device; False when there was no new one."""

    def conditions(self, now_ns: int) -> Sequence[Condition]:
        """Checks of the device whose state has changed since the last call; at first all of them."""
        return ()

    @abstractmethod
    def failsafe(self, now_ns: int) -> str:
        """Reason why the device is in its safe state, because its set-points do not arrive; else empty."""


class Site(msgspec.Struct, frozen=True):
    """The platform on which a driver runs."""

    kind: PlatformKind
    """uav | ugv | usv | gcs."""
    data_dir: str
    """The folder share/swarm/data."""
    airframe: "Airframe | None" = None
    """Airframe that the flight controller flies; None: the chassis has its own attitude control."""


Factory = Callable[[Config, Site], Sequence[Device]]
"""Type of a driver's entry point: creates its drivers, one per device."""
