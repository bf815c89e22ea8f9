"""Every error a caller can meet: one root, one exit code each."""

from __future__ import annotations

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from typing import ClassVar


class SwarmError(Exception):
    """Root of all errors raised on purpose; says what was wrong, where, and what was expected."""

    exit_code: ClassVar[int] = 1


class InvalidInput(SwarmError, ValueError):
    """A value, file or argument that cannot be accepted as it is.

    A ValueError too: so msgspec states the place of a field whose Struct refuses its value.
    """

    exit_code = 7


class WireError(InvalidInput):
    """Bytes from outside that are no frame, no payload of the stated type, or too large."""


class ConfigError(InvalidInput):
    """A configuration, template or world file with an unknown key, a wrong type, a value out of range."""


class MissionError(InvalidInput):
    """A mission that cannot be loaded or must not be flown."""


class TypeMismatch(InvalidInput):
    """A value of another type than the resource has."""


class OutOfRange(InvalidInput):
    """A value outside the range that the resource allows."""


class NotFound(SwarmError):
    """A path, platform, service, file or mission that does not exist."""

    exit_code = 6


class Denied(SwarmError):
    """A right is missing: access, role, certificate or file permission."""

    exit_code = 5


class NoAnswer(SwarmError):
    """The other side did not answer in time, or cannot be reached."""

    exit_code = 4


class Conflict(SwarmError):
    """Somebody else holds it, or it has changed since it was read."""


class Partial(SwarmError):
    """Some members did, some did not; or data was lost on the way."""

    exit_code = 3


KINDS: dict[str, type[SwarmError]] = {
    cls.__name__: cls
    for cls in (
        SwarmError,
        InvalidInput,
        WireError,
        ConfigError,
        MissionError,
        TypeMismatch,
        OutOfRange,
        NotFound,
        Denied,
        NoAnswer,
        Conflict,
        Partial,
    )
}
"""Class by name: how an error crosses a process border and is raised again on the other side."""


def from_kind(kind: str, message: str) -> SwarmError:
    """The error that another process reported, as its own class; an unknown kind becomes a SwarmError."""
    return KINDS.get(kind, SwarmError)(message)


def missing_extra(what: str, error: ImportError, extra: str) -> ConfigError:
    """The error of a part whose modules are not installed; `extra`: of the distribution, brings them."""
    return ConfigError(
        f"{what}: the module {error.name} is not installed; expected `pip install 'swarmware[{extra}]'`"
    )
