"""The resource: a named value or service of a platform, and its descriptor."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Literal

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model import names
from swarmware.model.open_enum import OpenEnum


class Kind(OpenEnum):
    """Kind of a resource, which determines how its values are transported."""

    BRANCH = "branch"
    """An inner node of the tree: has a description, no value."""
    BOARD = "board"
    """Only the newest value counts; a reader knows its age."""
    EVENT = "event"
    """An occurrence: each one is delivered."""
    COMMAND = "command"
    """A message or request that the owner executes."""
    STREAM = "stream"
    """A sequence of items, delivered completely and in order."""
    FILE = "file"
    """Data that is delivered completely and correctly, or not at all."""
    SETTING = "setting"
    """A persistent value that an operator may change; readable as a board."""


Access = Literal["r", "rw"]
Category = Literal["", "periodic", "conditional"]
Link = Literal["", "tick", "notify", "request"]
Plain = bool | int | float | str

STALE_PERIODS = 3.0
"""Periods after which a periodic value is stale: the loss of two datagrams in a row is common."""

SLOWEST_HZ = 1e-6
FASTEST_HZ = 1e6
OLDEST_S = 1e9
"""Periods and ages in nanoseconds fit 64 bits: a descriptor comes over the wire."""

_LOG = re.compile(r"^(?:all|none|(?:[0-9]+(?:\.[0-9]+)?)hz)$")
_PLAIN_TYPES: dict[str, type[Plain]] = {"Float": float, "Int": int, "Bool": bool, "Text": str}


class Resource(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, forbid_unknown_fields=True):
    """Descriptor of one resource: all its properties without its value.

    Empty `category` and `link` are filled in when the descriptor is made, from kind and rate.
    Raises: InvalidInput when two fields contradict each other.
    """

    path: str
    """Local path, without the platform: `nav/pose`."""
    kind: Kind = Kind.BOARD
    """Kind of the resource, which determines the transport of its values."""
    type: str = ""
    """Name of the registered Struct (a command's request), or "" for a branch."""
    reply: str = ""
    """Name of the Struct of a command's reply, or "" without one."""
    unit: str = ""
    """SI unit of a plain value; or "" if the field names of the Struct contain it."""
    range: tuple[float, float] | None = None
    """Minimum and maximum permitted number, both included."""
    choices: tuple[str, ...] = ()
    """The permitted texts, or () if any text is permitted."""
    access: Access = "r"
    """Access of other applications: r (read only) or rw (read and set)."""
    rate_hz: float = 0.0
    """Nominal rate of a periodic resource, or 0 without a period."""
    critical: bool = False
    """True if a lost value is an error, because the platform must not move without it; else a warning."""
    max_age_s: float = 0.0
    """Age above which the value is stale, or 0 for three periods (never without a period)."""
    category: Category = ""
    """Occurrence of the values: with a period, or under a condition."""
    link: Link = ""
    """Default transport to other platforms: in the beacon, by notification, or only on request."""
    log: str = "none"
    """Values that the logger records: `all`, `<n>hz` (decimated), `none`."""
    owner: str = ""
    """Name of the application that provides the resource."""
    default: Plain | None = None
    """Initial value of a setting."""
    description: str = ""
    """Meaning of the resource, as text for operators."""
    confirm: str = ""
    """Effect of a change, which an operator must confirm, or "" without a confirmation."""

    def __post_init__(self) -> None:
        names.check_path(self.path)
        if self.path.startswith("/"):
            raise InvalidInput(f"path {self.path!r}: names a platform; expected a local path: nav/pose")
        if not self.kind.known:
            raise InvalidInput(f"kind of {self.path}: {self.kind.value!r}, expected one of {', '.join(Kind)}")
        if not self.category:
            periodic = self.rate_hz > 0 and self.kind in {Kind.BOARD, Kind.STREAM}
            msgspec.structs.force_setattr(self, "category", "periodic" if periodic else "conditional")
        if not self.link:
            msgspec.structs.force_setattr(self, "link", self._default_link())
        self._check()

    def _default_link(self) -> Link:
        if self.kind in {Kind.COMMAND, Kind.FILE, Kind.BRANCH, Kind.STREAM}:
            return "request"
        return "tick" if self.kind is Kind.BOARD and self.category == "periodic" else "notify"

    def _check(self) -> None:
        if not _LOG.match(self.log):
            raise InvalidInput(f"log of {self.path}: {self.log!r}, expected 'all', 'none' or '<n>hz'")
        if self.rate_hz != 0 and not SLOWEST_HZ <= self.rate_hz <= FASTEST_HZ:
            raise InvalidInput(
                f"rate_hz of {self.path}: {self.rate_hz}, expected 0 or {SLOWEST_HZ} to {FASTEST_HZ:g}"
            )
        if not 0 <= self.max_age_s <= OLDEST_S:
            raise InvalidInput(f"max_age_s of {self.path}: {self.max_age_s}, expected 0 to {OLDEST_S:g}")
        if self.range is not None and not self.range[0] <= self.range[1]:
            raise InvalidInput(f"range of {self.path}: {list(self.range)}, expected [minimum, maximum]")
        if self.kind is not Kind.BRANCH and not self.type:
            raise InvalidInput(f"type of {self.path}: missing, expected the name of a type")
        if self.confirm and not self.writable:
            raise InvalidInput(f"confirm of {self.path}: it cannot be set; expected access 'rw'")
        if self.link == "tick" and self.kind is not Kind.BOARD:
            raise InvalidInput(f"link of {self.path}: 'tick' carries boards only, not a {self.kind}")
        if self.kind is Kind.SETTING and self.default is None:
            raise InvalidInput(f"default of {self.path}: missing, expected the first value of the setting")
        if self.default is not None:
            self._check_default(self.default)

    def _check_default(self, default: Plain) -> None:
        expected = _PLAIN_TYPES.get(self.type)
        if expected is None:
            raise InvalidInput(
                f"default of {self.path}: only {', '.join(_PLAIN_TYPES)} have one, not {self.type}"
            )
        fits = type(default) is expected or (expected is float and type(default) is int)
        if not fits:
            raise InvalidInput(f"default of {self.path}: {default!r}, expected {self.type}")
        if self.range is not None and not isinstance(default, str) and not self.in_range(default):
            low, high = self.range
            raise InvalidInput(f"default of {self.path}: {default}, expected {low}..{high}")
        if self.choices and default not in self.choices:
            raise InvalidInput(
                f"default of {self.path}: {default!r}, expected one of {', '.join(self.choices)}"
            )

    def in_range(self, value: float) -> bool:
        """Whether a number is within the range; NaN is not within any range."""
        return self.range is None or self.range[0] <= value <= self.range[1]

    @property
    def data_id(self) -> int:
        """Id of path and type in frame headers."""
        return names.data_id(self.path, self.type)

    @property
    def periodic(self) -> bool:
        return self.category == "periodic"

    @property
    def writable(self) -> bool:
        return self.access == "rw"

    @property
    def stale_after_s(self) -> float:
        """Age from which the value is stale; infinite for a conditional one without a limit."""
        if self.max_age_s > 0:
            return self.max_age_s
        if self.periodic and self.rate_hz > 0:
            return STALE_PERIODS / self.rate_hz
        return math.inf

    @property
    def log_hz(self) -> float:
        """Rate at which the logger records it: 0 for never, infinite for all values."""
        if self.log == "all":
            return math.inf
        return 0.0 if self.log == "none" else float(self.log[:-2])


def clashes(resources: Iterable[Resource]) -> dict[str, Resource]:
    """Paths whose number an earlier resource of another path or type has, and that resource.

    A number has 32 bits: among 200 resources one in 200 000 trees has a pair.
    """
    first: dict[int, Resource] = {}
    found: dict[str, Resource] = {}
    for resource in resources:
        if resource.kind is Kind.BRANCH:
            continue  # never in a frame
        other = first.setdefault(resource.data_id, resource)
        if (other.path, other.type) != (resource.path, resource.type):
            found[resource.path] = other
    return found


def clash_text(path: str, other: Resource) -> str:
    """The error about a path whose number another resource has."""
    return (
        f"{path}: its number {other.data_id:#010x} in frames belongs to {other.path} ({other.type});"
        " expected another name for one of them"
    )
