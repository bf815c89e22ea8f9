"""What a check has to say about a mission file."""

from typing import Literal

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

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        where = f" {self.pointer}:" if self.pointer else ""
        steps = f" (after {' → '.join(self.trace)})" if self.trace else ""
        return f"{place}:{where} {self.message}{steps}"


def sound(findings: list[Finding]) -> bool:
    """Whether nothing but warnings was found."""
    return all(finding.severity == "warning" for finding in findings)
