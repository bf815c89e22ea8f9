"""Interfaces of drivers: sensors publish measurements, actuators execute set-points."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from swarmd.hal.config import Config
from swarmd.hal.core.condition import Condition
from swarmd.hal.core.line_load import LineUse
from swarmware.errors import SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter

if TYPE_CHECKING:
    from swarmware.model.airframe import Airframe


W = TypeVar("W", bound=BoardWriter[Any])


class DeviceError(SwarmError):
    """The device is missing, or gave an invalid answer."""


class DeviceGone(DeviceError):
    """The device was unplugged, and must be opened again before further calls."""


class Device(ABC):
    """Base of drivers; a device is opened, served once per period, and closed.

    Each method may raise DeviceError or OSError. After several consecutive errors, or at once after a
    DeviceGone, the device is closed and opened again.
    """

    name: str
    """Name that is unique on the platform, such as `system` or `sim.gnss`."""
    period_s: float
    """Period of the driver, matched to the update rate of the device (S2.5); each call may change it."""
    line_uses: tuple[LineUse, ...] = ()
    """Load of lines and buses by this driver (S1.17)."""
    _withdrawals: tuple[Callable[[], None], ...] = ()
    """One call for each writer that `close` closes."""

    async def open(self, module: Module) -> None:  # noqa: B027  # some devices need no opening
        """Opens the device and the writers of its resources."""

    def managed(self, module: Module, writer: W) -> W:
        """Notes a writer, which `close` of the base closes, and returns it."""
        self._withdrawals = (*self._withdrawals, partial(module.close_writer, writer))
        return writer

    async def close(self) -> None:
        """Closes the managed writers; a driver with more to close overrides and calls it."""
        withdrawals, self._withdrawals = self._withdrawals, ()
        for withdraw in withdrawals:
            withdraw()


class Sensor(Device):
    """Base of drivers of devices that measure."""

    @abstractmethod
    async def read(self, now_ns: int) -> bool:
        """Reads the device and publishes its values; returns False if there are no new values."""

    def stalled(self, now_ns: int) -> str:
        """Reason why an answering device has no measurements, or "" if it has."""
        return ""


Driver = Sensor
"""Name of a sensor's driver in packages that were written for version 0.1."""


class Actuator(Device):
    """Base of drivers of devices that act, each with a watchdog."""

    @abstractmethod
    async def write(self, now_ns: int) -> bool:
        """Sends the newest set-point to the device; returns False if there is no new set-point."""

    def conditions(self, now_ns: int) -> Sequence[Condition]:
        """Checks of the device whose state has changed since the last call; the first call returns all
        checks."""
        return ()

    @abstractmethod
    def failsafe(self, now_ns: int) -> str:
        """Reason why the device is in its safe state for lack of set-points, or "" if it is not."""


class Site(msgspec.Struct, frozen=True):
    """The platform on which a driver runs."""

    kind: PlatformKind
    """Kind of the platform: uav, ugv, usv or gcs."""
    data_dir: str
    """Path of the folder share/swarm/data."""
    airframe: "Airframe | None" = None
    """Airframe of the flight controller, or None for a chassis with its own attitude control."""


Factory = Callable[[Config, Site], Sequence[Device]]
"""Type of a driver's entry point: creates its drivers, one per device."""
