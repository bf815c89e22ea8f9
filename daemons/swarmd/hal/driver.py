"""The interface of a driver."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import msgspec

from swarmd.hal.config import Config
from swarmware.errors import SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module


class DeviceError(SwarmError):
    """The device is missing, or gave an invalid answer."""


class Driver(ABC):
    """Driver of one device: opened, read once per period in its own task, closed.

    `open` and `read` may raise DeviceError or OSError; the device is then opened again.
    """

    name: str
    """Unique on the platform: `system`, `sim.gnss`."""
    period_s: float
    """Period of `read`, matched to the update rate of the device (S2.5); each read may change it."""

    async def open(self, module: Module) -> None:  # noqa: B027  # some devices need no opening
        """Opens the device and the writers of its resources."""

    @abstractmethod
    async def read(self, now_ns: int) -> bool:
        """Reads the device and publishes its values; False when it had no new ones."""

    async def close(self) -> None:  # noqa: B027  # some devices need no closing
        """Closes the device and its writers."""


class Site(msgspec.Struct, frozen=True):
    """The platform on which a driver runs."""

    kind: PlatformKind
    """uav | ugv | usv | gcs."""
    data_dir: str
    """The folder share/swarm/data."""


Factory = Callable[[Config, Site], list[Driver]]
"""Type of a driver's entry point: creates its drivers, one per device."""
