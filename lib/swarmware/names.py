"""Names of the system: platforms, hardware units, applications, resource paths and patterns."""

import re
from hashlib import blake2b
from typing import Final

from swarmware.errors import InvalidInput

ANY: Final = 0xFFFF_FFFF
"""Receiver id of whoever is interested (S1.49)."""

PATH_LIMIT: Final = 200
"""Longest resource path in characters: keeps ring file names under the 255 bytes of every file system."""

_PLATFORM = re.compile(r"[a-z][a-z0-9_]{0,30}\Z")
_SEGMENT = re.compile(r"[a-z0-9_]+\Z")
_APPLICATION = re.compile(r"[a-z][a-z0-9_-]{0,30}\Z")
_NUMBER = re.compile(r"(\d+)")


def check_platform(name: str) -> str:
    """The platform name itself.

    Raises: InvalidInput when it is no platform name.
    """
    if not _PLATFORM.match(name):
        raise InvalidInput(f"platform name {name!r}: expected [a-z][a-z0-9_]{{0,30}}, such as uav3")
    return name


def check_application(name: str) -> str:
    """The application name itself.

    Raises: InvalidInput when it is no application name.
    """
    if not _APPLICATION.match(name):
        raise InvalidInput(f"application name {name!r}: expected [a-z][a-z0-9_-]{{0,30}}, such as planner")
    return name


def check_path(path: str) -> str:
    """The resource path itself, local (`nav/pose`) or global (`/uav3/nav/pose`).

    Raises: InvalidInput naming the segment that is wrong.
    """
    segments = path.removeprefix("/").split("/")
    if len(path) > PATH_LIMIT:
        raise InvalidInput(f"path {path[:40]!r}…: {len(path)} characters, expected at most {PATH_LIMIT}")
    for segment in segments:
        if not _SEGMENT.match(segment):
            raise InvalidInput(f"path {path!r}: segment {segment!r}: expected [a-z0-9_]+")
    if path.startswith("/"):
        check_platform(segments[0])
    return path


def split(path: str) -> tuple[str | None, str]:
    """Platform and local path: `/uav3/nav/pose` → (`uav3`, `nav/pose`), `nav/pose` → (None, `nav/pose`)."""
    if not path.startswith("/"):
        return None, path
    platform, _, local = path[1:].partition("/")
    return platform, local


def join(platform: str, local: str) -> str:
    """Global path of a platform's resource."""
    return f"/{platform}/{local}" if local else f"/{platform}"


def natural(name: str) -> tuple[str | int, ...]:
    """Sort key under which uav2 comes before uav10."""
    return tuple(int(part) if part.isdigit() else part for part in _NUMBER.split(name))


def _id(text: str) -> int:
    value = int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "little")
    return value if value not in (0, ANY) else 1  # 0 is nobody, all ones is everybody


def hardware_id(platform: str, unit: str = "main") -> int:
    """Number of a hardware unit in frame headers (S1.39)."""
    return _id(f"{platform}.{unit}")


def application_id(name: str, instance: int) -> int:
    """Number of an application instance in frame headers (S1.39, S1.40)."""
    return _id(f"{name}#{instance}")


def data_id(local_path: str, type_name: str) -> int:
    """Number of a resource and its type in frame headers: both sides must agree on both (S1.38)."""
    return _id(f"{local_path}:{type_name}")


class Pattern:
    """Matches paths: `*` is one segment, `**` any depth (also none), `{uav,ugv}*` alternatives."""

    __slots__ = ("_regex", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self._regex = re.compile(_regex(text))

    def matches(self, path: str) -> bool:
        """Whether the whole path matches."""
        return self._regex.fullmatch(path) is not None

    @property
    def literal(self) -> bool:
        """Whether the pattern is a plain path."""
        return not any(c in self.text for c in "*{")

    @property
    def prefix(self) -> str:
        """The part before the first wildcard, cut at a slash: where an index scan may start."""
        head = re.split(r"[*{]", self.text, maxsplit=1)[0]
        return head if self.literal else head[: head.rfind("/") + 1]

    def __repr__(self) -> str:
        return f"Pattern({self.text!r})"


def _regex(text: str) -> str:
    out: list[str] = []
    segments = text.split("/")
    for index, segment in enumerate(segments):
        if segment == "**":
            # "a/**" also matches "a": the slash belongs to the optional part
            out.append("(?:/[a-z0-9_]+)*" if index else "[a-z0-9_]*(?:/[a-z0-9_]+)*")
        else:
            out.append(("/" if index else "") + _segment_regex(text, segment))
    return "".join(out)


def _segment_regex(text: str, segment: str) -> str:
    out: list[str] = []
    depth = 0
    for char in segment:
        if char == "*":
            out.append("[a-z0-9_]*" if len(segment) > 1 else "[a-z0-9_]+")
        elif char == "{":
            depth += 1
            out.append("(?:")
        elif char == "}" and depth:
            depth -= 1
            out.append(")")
        elif char == "," and depth:
            out.append("|")
        elif _SEGMENT.match(char):
            out.append(char)
        else:
            raise InvalidInput(f"pattern {text!r}: unexpected {char!r}; expected [a-z0-9_/], *, **, {{a,b}}")
    if depth:
        raise InvalidInput(f"pattern {text!r}: a '{{' is not closed")
    return "".join(out)
