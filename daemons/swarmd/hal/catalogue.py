"""Registry of drivers by name: built-in drivers, and plug-ins of the entry-point group
`swarmware.drivers`."""

from collections.abc import Sequence
from importlib import import_module
from typing import Final

from swarmd.hal.chassis import Chassis
from swarmd.hal.config import Config
from swarmd.hal.core.line_load import crowded
from swarmd.hal.driver import Device, Factory, Site
from swarmware.errors import ConfigError, NotFound
from swarmware.footprint.entry_points import DRIVER_GROUP, OWN_DRIVERS, entry_points

DRIVERS: Final = {name: f"swarmd.hal.drivers.{name}" for name in OWN_DRIVERS}
"""Modules of the built-in drivers, with a function `make(config, site)`; imported only when configured."""


def find(name: str) -> Factory:
    """Finds the factory of a driver.

    Raises: NotFound when the driver is not installed.
    """
    if name in DRIVERS:
        # imported on demand, because most drivers need libraries that other vehicles do not have
        make: Factory = import_module(DRIVERS[name]).make
        return make
    points = {point.name: point for point in entry_points(DRIVER_GROUP)}
    if name not in points:
        known = ", ".join(sorted({*DRIVERS, *points}))
        raise NotFound(f"driver {name!r}: not installed; expected one of {known}")
    loaded: Factory = points[name].load()
    if not callable(loaded):
        raise ConfigError(f"driver {name!r}: {points[name].value}, expected a function make(config, site)")
    return loaded


def make_all(config: Config, site: Site) -> list[Device]:
    """Creates the configured drivers of a platform.

    Raises: NotFound or ConfigError, as `find` and `check_names` do.
    """
    found: list[Device] = []
    for name in config.drivers:
        found += find(name)(config, site)
    check_names(found, ())
    return found


def check_names(devices: Sequence[Device], present: Sequence[Device]) -> None:
    """Checks that drivers do not conflict with each other or with the present drivers.

    Raises: ConfigError when two have the same name or the same line, or both are chassis.
    """
    both = [*present, *devices]
    uses = [(device.name, use) for device in both for use in device.line_uses]
    if (found := crowded(uses)) is not None:
        line, one, other = found
        raise ConfigError(
            f"services/hal.toml: device {line}: both {one} and {other} need it; expected a line for each"
        )
    names = [device.name for device in both]
    if doubles := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"services/hal.toml: key drivers: {doubles[0]} is listed twice, expected once")
    chassis = [device.name for device in both if isinstance(device, Chassis)]
    if len(chassis) > 1:
        raise ConfigError(
            f"services/hal.toml: key drivers: {' and '.join(chassis)} both drive the vehicle, expected one"
        )
