"""Installed services, by entry point."""

from functools import cache
from pathlib import Path

import msgspec

from swarmware.errors import ConfigError, NotFound
from swarmware.footprint.entry_points import SERVICE_GROUP, EntryPoint, entry_points
from swarmware.model.config import load_service
from swarmware.model.names import similar
from swarmware.service.service import Service


@cache
def installed() -> dict[str, EntryPoint]:
    """Entry points of services, by name."""
    return {point.name: point for point in entry_points(SERVICE_GROUP)}


def find(name: str) -> type[Service]:
    """The class of a service.

    Raises: NotFound for a name that is not installed, ConfigError for an entry point that is not a service.
    """
    points = installed()
    if name not in points:
        near = similar(name, points)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(points)}"
        raise NotFound(f"service {name!r}: not installed; {hint}")
    found = points[name].load()
    if not (isinstance(found, type) and issubclass(found, Service)):
        raise ConfigError(f"service {name!r}: {points[name].value} is not a Service")
    if found.name != name:
        raise ConfigError(
            f"service {name!r}: {points[name].value} is named {found.name!r}; expected one name"
        )
    return found


def load_config(service: type[Service], config_dir: Path) -> msgspec.Struct:
    """Configuration of a service, from its own file, or the file of the service to which it belongs.

    Raises: ConfigError when the file is invalid.
    """
    return load_service(config_dir, service.settings_of or service.name, service.Config)
