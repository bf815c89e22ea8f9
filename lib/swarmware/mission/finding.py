"""Findings of the checks of mission files."""

from collections.abc import Iterable
from typing import Final, Literal

import msgspec

Severity = Literal["error", "warning", "unknown"]
"""`unknown`: the budget was exceeded, so the check has no result."""


class Finding(msgspec.Struct, frozen=True):
    """One finding about a mission, with its place in the file."""

    file: str
    line: int
    """Line, from 1, or 0 for the whole file."""
    pointer: str
    """JSON pointer of the value (RFC 6901), such as /mission/b3/next."""
    severity: Severity
    rule: str
    """Short name of the rule, for filters: syntax, unknown-block, deadlock, …"""
    message: str
    """The error, and the expected value."""
    trace: tuple[str, ...] = ()
    """Counter-example: the outcomes of blocks that lead to this state, in order."""
    column: int = 0
    """Column, from 1, or 0 for the whole value."""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        if self.column:
            place += f":{self.column}"
        where = f" {self.pointer}:" if self.pointer else ""
        steps = f" (after {' → '.join(self.trace)})" if self.trace else ""
        return f"{place}:{where} {self.message}{steps}"


class Remark(msgspec.Struct, frozen=True):
    """A finding without file and line, which the caller adds."""

    block: str
    severity: Severity
    rule: str
    message: str
    trace: tuple[str, ...] = ()

    def finding(self, file: str, line: int, pointer: str) -> Finding:
        """The finding, with its place."""
        return Finding(file, line, pointer, self.severity, self.rule, self.message, self.trace)


TOO_LARGE: Final = "too-large"
"""Rule of the finding that the check's budget of memory and time was exceeded."""


def too_large(file: str) -> Finding:
    """The finding of an abandoned check."""
    message = "too large to check: memory or time ran out; expected fewer blocks that run at the same time"
    return Finding(file, 0, "", "unknown", TOO_LARGE, message)


def sound(findings: Iterable[Finding]) -> bool:
    """Whether there are only warnings."""
    return all(finding.severity == "warning" for finding in findings)
