"""Names of the system: platforms, hardware units, applications, resource paths and patterns."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from functools import lru_cache
from typing import Final, NamedTuple

from swarmware.errors import InvalidInput
from swarmware.footprint.blake2b import blake2b

ANY: Final = 0xFFFF_FFFF
"""Receiver id of frames for all receivers (S1.49)."""
MAIN: Final = "main"
"""Unit of a platform with one computer; of several computers, the unit with the template's resources."""
UNIT_BRANCHES: Final = frozenset({"app", "guard", "health", "log", "net", "register", "time", "tree"})
"""First segments of the resources that every computer of a platform has for itself."""
UNIT_SERVICES: Final = frozenset({"broker", "guard", "health", "log", "node", "register", "time", "tree"})
"""Second segments below `sys` that every computer has for itself; the platform has one of each other."""

PATH_LIMIT: Final = 200
"""Longest resource path in characters: keeps ring file names under the 255 bytes of every file system."""

_PLATFORM = re.compile(r"[a-z][a-z0-9_]{0,30}\Z")
_SEGMENT = re.compile(r"[a-z0-9_]+\Z")
_APPLICATION = re.compile(r"[a-z][a-z0-9_-]{0,30}\Z")
_NUMBER = re.compile(r"(\d+)")

_REMEMBERED: Final = 4096
"""Size of the caches for checks and ids: the same names occur in every message."""

PATTERN_LIMIT: Final = 400
"""Longest pattern in characters: a path with room for alternatives."""
WILDCARDS_LIMIT: Final = 8
"""Maximum wildcards of a pattern, consecutive stars counted once: more than the templates are deep."""
ALTERNATIVES_LIMIT: Final = 64
"""Maximum alternatives of the braces in one segment; nested ones multiply."""


def check_platform(name: str) -> str:
    """Check a platform name, and return it.

    Raises: InvalidInput when it is not a platform name.
    """
    if not _PLATFORM.match(name):
        raise InvalidInput(f"platform name {name!r}: expected [a-z][a-z0-9_]{{0,30}}, such as uav3")
    return name


class Address(NamedTuple):
    """A computer: a unit of a platform. Its text is `uav3`, or `uav3.fc` where the unit is not `main`."""

    platform: str
    unit: str = MAIN

    @classmethod
    def parse(cls, text: str) -> "Address":
        """The address of this text, which may also name the unit `main`.

        Raises: InvalidInput.
        """
        platform, dot, unit = text.partition(".")
        check_platform(platform)
        return cls(platform, check_platform(unit)) if dot else cls(platform)

    @property
    def hardware(self) -> int:
        """Hardware id in frame headers."""
        return hardware_id(self.platform, self.unit)

    @property
    def path(self) -> str:
        """The text with its unit in any case, as in paths of exactly this computer: `uav3.main`."""
        return f"{self.platform}.{self.unit}"

    def __str__(self) -> str:
        return self.platform if self.unit == MAIN else f"{self.platform}.{self.unit}"


def check_computer(name: str) -> str:
    """Check the name of a platform or of one of its units, and return it.

    Raises: InvalidInput.
    """
    Address.parse(name)
    return name


def platform_of(name: str) -> str:
    """Platform of a computer's name: of `uav3.fc` it is `uav3`."""
    return name.partition(".")[0]


def has_unit_branch(local: str) -> bool:
    """Whether every computer of a platform has the resource at this local path for itself."""
    first, _, rest = local.partition("/")
    return first in UNIT_BRANCHES or (first == "sys" and rest.partition("/")[0] in UNIT_SERVICES)


def check_application(name: str) -> str:
    """Check an application name, and return it.

    Raises: InvalidInput when it is not an application name.
    """
    if not _APPLICATION.match(name):
        raise InvalidInput(f"application name {name!r}: expected [a-z][a-z0-9_-]{{0,30}}, such as planner")
    return name


def segment(application: str) -> str:
    """The application's name in resource paths: `temp-sensor` → `app/temp_sensor/status`.

    Two applications whose names differ only in this cannot run on one node.
    """
    return application.replace("-", "_")


@lru_cache(maxsize=_REMEMBERED)
def check_path(path: str) -> str:
    """Check a resource path, local (`nav/pose`) or global (`/uav3/nav/pose`), and return it.

    `/uav3.fc/nav/pose` is the resource of one computer of the platform.

    Raises: InvalidInput naming the invalid segment.
    """
    segments = path.removeprefix("/").split("/")
    if len(path) > PATH_LIMIT:
        raise InvalidInput(f"path {path[:40]!r}…: {len(path)} characters, expected at most {PATH_LIMIT}")
    computer, dot, unit = segments[0].partition(".")
    if dot and path.startswith("/") and _PLATFORM.match(unit):
        # the only dot of a path: the unit of a computer, which has its own check
        segments[0] = computer
    for segment in segments:
        if not _SEGMENT.match(segment):
            raise InvalidInput(f"path {path!r}: segment {segment!r}: expected [a-z0-9_]+")
    if path.startswith("/"):
        check_platform(segments[0])
    return path


def split(path: str) -> tuple[str | None, str]:
    """Platform, or computer, and local path: `/uav3/nav/pose` → (`uav3`, `nav/pose`), `nav/pose` → (None,
    `nav/pose`)."""
    if not path.startswith("/"):
        return None, path
    platform, _, local = path[1:].partition("/")
    return platform, local


def split_field(text: str) -> tuple[str, str]:
    """Path and field of a value: `/uav3.fc/nav/pose.x_m` → (`/uav3.fc/nav/pose`, `x_m`); the dot of a
    computer is part of its path."""
    end = text.find("/", 1) if text.startswith("/") else 0
    dot = text.find(".", end) if end >= 0 else -1
    return (text, "") if dot < 0 else (text[:dot], text[dot + 1 :])


def join(platform: str, local: str) -> str:
    """Global path of a platform's resource."""
    return f"/{platform}/{local}" if local else f"/{platform}"


def natural(name: str) -> tuple[str | int, ...]:
    """Sort key under which uav2 comes before uav10."""
    # split puts texts and numbers in turn, so that keys of two names are comparable
    return tuple(int(part) if part.isdigit() else part for part in _NUMBER.split(name))


@lru_cache(maxsize=_REMEMBERED)
def _id(text: str) -> int:
    value = int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "little")
    return value if value not in (0, ANY) else 1  # 0 means no receiver, all ones means all receivers


def hardware_id(platform: str, unit: str = MAIN) -> int:
    """Number of a hardware unit in frame headers (S1.39), of a unit or of the name of a computer."""
    return _id(platform if "." in platform else f"{platform}.{unit}")


def application_id(name: str, instance: int) -> int:
    """Number of an application instance in frame headers (S1.39, S1.40)."""
    return _id(f"{name}#{instance}")


def data_id(local_path: str, type_name: str) -> int:
    """Number of a resource and its type in frame headers: both sides must agree on both (S1.38)."""
    return _id(f"{local_path}:{type_name}")


class Pattern:
    """Matches paths: `*` is (a part of) one segment, `**` any depth (also zero), `{uav,ugv}*` alternatives.

    The time of a match is proportional to the length of the path for every pattern: patterns come from
    outside.
    Raises: InvalidInput when it is not a pattern, or has more wildcards or alternatives than the limits.
    """

    __slots__ = ("_compiled", "_regex", "text")

    def __init__(self, text: str, *, of_computers: bool = False) -> None:
        """`of_computers`: for names of computers, in which a point separates the unit: `uav*.fc`."""
        self.text = text
        if len(text) > PATTERN_LIMIT:
            raise InvalidInput(
                f"pattern {text[:40]!r}…: {len(text)} characters; expected at most {PATTERN_LIMIT}"
            )
        wildcards = len(_STARS.findall(text))
        if wildcards > WILDCARDS_LIMIT:
            raise InvalidInput(f"pattern {text!r}: {wildcards} wildcards; expected at most {WILDCARDS_LIMIT}")
        self._regex = _regex(text, of_computers)
        self._compiled: re.Pattern[str] | None = None
        """Made by the first match: most processes have rules that they never apply."""

    def matches(self, path: str) -> bool:
        """Whether the whole path matches."""
        if self._compiled is None:
            self._compiled = re.compile(self._regex)
        return self._compiled.fullmatch(path) is not None

    @property
    def names_unit(self) -> bool:
        """Whether the pattern matches names of computers with their unit: `uav*.fc`."""
        return self.text.count(".") > 0

    @property
    def literal(self) -> bool:
        """Whether the pattern is a plain path."""
        return not any(c in self.text for c in "*{")

    @property
    def prefix(self) -> str:
        """The part before the first wildcard, cut at a slash: prefix of a range search in an index."""
        head = re.split(r"[*{]", self.text, maxsplit=1)[0]
        return head if self.literal else head[: head.rfind("/") + 1]

    def __repr__(self) -> str:
        return f"Pattern({self.text!r})"


_STARS = re.compile(r"\*+")
_DEEP: Final = "**"
_CHAR: Final = "[a-z0-9_]"
_END: Final = r"(?=/|\Z)"
"""End of each segment. Every part below consumes the minimum and keeps it (atomic groups): if the rest
does not match after the first match of a part, it does not match after any other."""


def _regex(text: str, of_computers: bool) -> str:
    groups: list[list[str]] = [[]]
    """Segments between the `**`."""
    for segment in text.split("/"):
        if segment != _DEEP:
            groups[-1].append(_segment(text, segment, of_computers))
        elif len(groups) == 1 or groups[-1]:  # `**/**` is `**`
            groups.append([])
    first, *rest = groups
    out = "/".join(first)
    for number, group in enumerate(rest, 1):
        slash = "/" if first or number > 1 else ""
        if group:
            chunk = slash + "/".join(group) + (r"\Z" if number == len(rest) else "")
            out += f"(?>(?:/{_CHAR}++)*?{chunk})" if slash else f"/?(?>(?:{_CHAR}++/)*?{chunk})"
        else:
            out += ("" if slash else f"{_CHAR}*+") + f"(?:/{_CHAR}++)*+"
    return out


def _segment(text: str, segment: str, of_computers: bool) -> str:
    globs = {_STARS.sub("*", glob) for glob in _alternatives(text, segment, of_computers)}
    return f"(?>{'|'.join(map(_glob, sorted(globs)))})"


def _glob(glob: str) -> str:
    """One alternative of a segment, with no braces."""
    if glob == "*":
        return f"{_CHAR}++{_END}"
    first, *rest = glob.split("*")
    if not rest:
        return first + _END
    *middle, last = rest
    out = first + "".join(f"(?>{_CHAR}*?{chunk})" for chunk in middle)
    return out + (f"(?>{_CHAR}*?{last}{_END})" if last else f"{_CHAR}*+{_END}")


def _alternatives(text: str, segment: str, of_computers: bool) -> list[str]:
    """All expansions of the braces of a segment."""
    # of each open brace: the alternatives that are complete, and the one being read
    done: list[list[str]] = [[]]
    open_: list[list[str]] = [[""]]
    for char in segment:
        if char == "{":
            done.append([])
            open_.append([""])
        elif char == "," and len(done) > 1:
            done[-1] += open_[-1]
            open_[-1] = [""]
        elif char == "}" and len(done) > 1:
            inner = done.pop() + open_.pop()
            # before they are multiplied: nested braces grow exponentially
            if len(inner) * len(open_[-1]) > ALTERNATIVES_LIMIT:
                raise InvalidInput(
                    f"pattern {text!r}: {segment!r} has too many alternatives; expected at most"
                    f" {ALTERNATIVES_LIMIT}"
                )
            open_[-1] = [head + tail for head in open_[-1] for tail in inner]
        elif char == "*" or _SEGMENT.match(char):
            open_[-1] = [head + char for head in open_[-1]]
        elif char == "." and of_computers:
            open_[-1] = [head + r"\." for head in open_[-1]]
        else:
            raise InvalidInput(f"pattern {text!r}: unexpected {char!r}; expected [a-z0-9_/], *, **, {{a,b}}")
    if len(done) > 1:
        raise InvalidInput(
            f"pattern {text!r}: a '{{' is not closed in {segment!r}; expected '}}' in the same segment"
        )
    return open_[0]


def similar(word: str, known: Iterable[str], *, limit: int = 1, cutoff: float = 0.6) -> list[str]:
    """The known names that are most similar to this one, best match first.

    `cutoff`: minimum similarity, 0 to 1.
    """
    return get_close_matches(word, known, n=limit, cutoff=cutoff)
