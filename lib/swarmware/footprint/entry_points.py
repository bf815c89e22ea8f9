"""Entry points of the installed packages: services, drivers and blocks.

`importlib.metadata` reads the same files, but loads the packages for mail and archives for it: 2.5 MB of
resident memory in each process of a node. Source: packaging.python.org, "Entry points specification".
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import msgspec

SERVICE_GROUP: Final = "swarmware.services"
DRIVER_GROUP: Final = "swarmware.drivers"
BLOCK_GROUP: Final = "swarmware.blocks"

OWN_DRIVERS: Final = (
    "adc",
    "bmp280",
    "camera",
    "crsf",
    "invensense",
    "nmea",
    "ppm",
    "pwm_flight",
    "recording",
    "replay",
    "serial_chassis",
    "servo",
    "sim",
    "sonar",
    "system",
    "vectornav",
    "vesc",
)
"""Drivers of the daemon hal itself, whose names no plug-in can have."""

_OWN: Final = "swarmd."
"""Start of what the entry points of this package name."""


class EntryPoint(msgspec.Struct, frozen=True):
    """A name that a package gives to one of its objects."""

    name: str
    value: str
    """`module:object`."""
    group: str

    def load(self) -> Any:
        """Import the module and return the object. Raises: ImportError, AttributeError."""
        module, _, attributes = self.value.partition(":")
        found: Any = import_module(module)
        for attribute in filter(None, attributes.split(".")):
            found = getattr(found, attribute)
        return found

    @property
    def is_own(self) -> bool:
        """Whether the entry point belongs to this package."""
        return self.value.startswith(_OWN)


def entry_points(group: str) -> list[EntryPoint]:
    """The entry points of a group, by name."""
    found = [point for point in _all() if point.group == group]
    return sorted(found, key=lambda point: point.name)


def none_is_foreign() -> bool:
    """Whether no other package has a service, driver or block installed here."""
    groups = (SERVICE_GROUP, DRIVER_GROUP, BLOCK_GROUP)
    return all(point.is_own for point in _all() if point.group in groups)


def _all() -> list[EntryPoint]:
    found: list[EntryPoint] = []
    packages: set[str] = set()
    for folder in map(Path, sys.path):
        try:
            paths = sorted(path for path in folder.iterdir() if path.suffix in {".dist-info", ".egg-info"})
        except OSError:
            continue  # an archive, or a folder that does not exist
        for path in paths:
            package = path.stem.partition("-")[0].lower().replace(".", "_")
            if package in packages:
                continue  # Python imports the first one on the path
            packages.add(package)
            try:
                found += _parsed((path / "entry_points.txt").read_text("utf-8"))
            except OSError:
                continue  # the package has no entry points
    return found


def _parsed(text: str) -> list[EntryPoint]:
    found: list[EntryPoint] = []
    group = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("[") and line.endswith("]"):
            group = line[1:-1].strip()
        elif line and not line.startswith(("#", ";")):
            name, _, value = line.partition("=")
            found.append(EntryPoint(name.strip(), value.partition("[")[0].strip(), group))
    return found
