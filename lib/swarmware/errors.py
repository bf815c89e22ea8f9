"""All errors that callers may receive: one root, one exit code for each class."""

from __future__ import annotations

import errno


class SwarmError(Exception):
    """Root of all expected errors; the message states the error, its place, and the expected value."""

    exit_code = 1


class InvalidInput(SwarmError, ValueError):
    """A value, file or argument that cannot be accepted as it is.

    Also a ValueError: so msgspec states the path of a field whose Struct refuses its value.
    """

    exit_code = 7


class WireError(InvalidInput):
    """Bytes from outside that are too large, or not a valid frame or payload of the stated type."""


class ConfigError(InvalidInput):
    """A configuration, template or world file with an unknown key, a wrong type, a value out of range."""

    def __init__(self, message: str = "", *, source: str = "", line: int = 0) -> None:
        """`source`: the file; `line`: from 1, 0 when the message is about the whole file."""
        place = f"{source}: " if source else ""
        super().__init__(f"{place}line {line}: {message}" if line else f"{place}{message}")
        self.message = message
        self.source = source
        self.line = line


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
    """A permission is missing: access, role, certificate or file mode."""

    exit_code = 5


class NoAnswer(SwarmError):
    """The other side did not answer in time, or cannot be reached."""

    exit_code = 4


class Conflict(SwarmError):
    """Another process holds the object, or it has changed since it was read."""


class Partial(SwarmError):
    """Only some members succeeded, or some data was lost."""

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
"""Classes by name: an error of another process is raised again as the same class."""


def from_kind(kind: str, message: str) -> SwarmError:
    """The error that another process reported, as its own class; an unknown kind becomes a SwarmError."""
    return KINDS.get(kind, SwarmError)(message)


def missing_extra(what: str, error: ImportError, extra: str) -> ConfigError:
    """The error when optional modules are not installed; `extra`: the extra of the distribution with them."""
    return ConfigError(
        f"{what}: the module {error.name} is not installed; expected `pip install 'swarmware[{extra}]'`"
    )


_EXPECTED = {
    errno.EMFILE: "a higher limit of open files (ulimit -n, LimitNOFILE=)",
    errno.ENFILE: "a higher limit of open files of the machine (fs.file-max)",
    errno.ENOSPC: "room on its file system",
    errno.EDQUOT: "room within the quota",
    errno.EROFS: "a file system that may be written",
    errno.EACCES: "permission for the user of this node",
    errno.EPERM: "permission for the user of this node",
    errno.ENOMEM: "free memory",
    errno.EIO: "a medium that works",
}
"""Errors of the environment, and the condition that an operator has to restore."""


def reason(error: BaseException) -> str | None:
    """The line for an error of the environment, or None for a defect, which needs its traceback."""
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    if isinstance(error, BaseExceptionGroup):
        reasons = [reason(one) for one in error.exceptions]
        if None in reasons:
            return None
        return "; ".join(dict.fromkeys(text for text in reasons if text is not None))
    if isinstance(error, SwarmError):
        return str(error)
    if isinstance(error, OSError) and error.errno in _EXPECTED:
        name = error.filename
        where = name.decode("utf-8", "surrogateescape") if isinstance(name, bytes) else name
        place = f"{where}: " if isinstance(where, str) else ""
        return f"{place}{(error.strerror or '').lower()}; expected {_EXPECTED[error.errno]}"
    return None
