"""What a check has to say about a mission file."""

from collections.abc import Iterable
from typing import Final, Literal

import msgspec

Severity = Literal["error", "warning", "unknown"]
"""`unknown`: the check ran out of room, so the mission is neither proven sound nor wrong."""


class Finding(msgspec.Struct, frozen=True):
    """One remark about a mission, with the place in the file."""

    file: str
    line: int
    """From 1; 0 when the remark is about the whole file."""
    pointer: str
    """JSON pointer of the value (RFC 6901), such as /mission/b3/next."""
    severity: Severity
    rule: str
    """Short name of the rule, for filters: syntax, unknown-block, deadlock, …"""
    message: str
    """What is wrong and what was expected."""
    trace: tuple[str, ...] = ()
    """Counter-example: block outcomes that lead there, in order."""
    column: int = 0
    """From 1; 0 when the remark is about the whole value."""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        if self.column:
            place += f":{self.column}"
        where = f" {self.pointer}:" if self.pointer else ""
        steps = f" (after {' → '.join(self.trace)})" if self.trace else ""
        return f"{place}:{where} {self.message}{steps}"


class Remark(msgspec.Struct, frozen=True):
    """A finding without its line: the caller knows the file."""

    block: str
    severity: Severity
    rule: str
    message: str
    trace: tuple[str, ...] = ()

    def finding(self, file: str, line: int, pointer: str) -> Finding:
        """The finding, with its place."""
        return Finding(file, line, pointer, self.severity, self.rule, self.message, self.trace)


TOO_LARGE: Final = "too-large"
"""Rule of a mission of which the check's budget of memory and time was not enough."""


def too_large(file: str) -> Finding:
    """A check that had to be given up."""
    message = "too large to check: memory or time ran out; expected fewer blocks that run at the same time"
    return Finding(file, 0, "", "unknown", TOO_LARGE, message)


def sound(findings: Iterable[Finding]) -> bool:
    """Whether nothing but warnings was found."""
    return all(finding.severity == "warning" for finding in findings)
