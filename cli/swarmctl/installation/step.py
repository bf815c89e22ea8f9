"""One step that changes a host."""

import shlex
from enum import StrEnum

import msgspec


class StepAction(StrEnum):
    """Kind of a step."""

    WRITE = "write"
    LINK = "link"
    REMOVE = "remove"
    RUN = "run"


class HostStep(msgspec.Struct, frozen=True):
    """One change of a host, and its reason."""

    action: StepAction
    target: str
    """Path of the file, link or folder; of RUN the command."""
    reason: str
    content: bytes = b""
    """Of WRITE the content, of LINK its target."""
    mode: int = 0o644
    words: tuple[str, ...] = ()
    """Program and arguments of RUN."""


def write(path: str, content: bytes, reason: str) -> HostStep:
    """The step that replaces a file."""
    return HostStep(StepAction.WRITE, path, reason, content)


def link(path: str, target: str, reason: str) -> HostStep:
    """The step that replaces a symbolic link."""
    return HostStep(StepAction.LINK, path, reason, target.encode())


def remove(path: str, reason: str) -> HostStep:
    """The step that removes a file, a link, or a folder with its content."""
    return HostStep(StepAction.REMOVE, path, reason)


def run(reason: str, *words: str) -> HostStep:
    """The step that runs a program, which must succeed."""
    return HostStep(StepAction.RUN, shlex.join(words), reason, words=words)
