"""What a driver is."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import msgspec

from swarmd.hal.config import Config
from swarmware.errors import SwarmError
from swarmware.module import Module


class DeviceError(SwarmError):
    """The device is not there, or did not answer as it should."""


class Driver(ABC):
    """One device: opened, read once per period in a task of its own, closed.

    `open` and `read` may raise DeviceError or OSError; the device is then tried again.
    """

    name: str
    """Unique on the platform: `system`, `sim.gnss`."""
    period_s: float
    """Matched to the device's update rate (S2.5)."""

    async def open(self, module: Module) -> None:  # noqa: B027  # some devices are simply there
        """Find the device, make the writers of the resources that it fills."""

    @abstractmethod
    async def read(self, now_ns: int) -> bool:
        """Take what the device has and publish it; False when it had nothing new."""

    async def close(self) -> None:  # noqa: B027  # some devices need no farewell
        """Let the device go."""


class Site(msgspec.Struct, frozen=True):
    """What a driver may want to know about where it runs."""

    kind: str
    """uav | ugv | usv | gcs."""
    data_dir: str
    """share/swarm/data."""


Factory = Callable[[Config, Site], list[Driver]]
"""What a driver's entry point is: makes its drivers, one per device."""
