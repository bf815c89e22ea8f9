"""Outcomes of blocks: the event that selects the successor."""

from enum import StrEnum
from typing import Final

import msgspec


class OutcomeKind(StrEnum):
    """Kinds of outcomes; the values are the words of a mission's file and of progress events."""

    OK = "ok"
    TIMEOUT = "timeout"
    ERROR = "error"
    CASE = "case"
    """The condition of this case of a Decision holds."""
    TRUE = "true"
    FALSE = "false"
    """Second successor of a DecisionRandom."""
    CANCELLED = "cancelled"
    ABANDONED = "abandoned"
    """Cancelled, but the block did not end in time."""
    SUSPENDED = "suspended"
    """Cancelled, because its mission makes way for another one."""
    FAILS = "fails"
    """In a net: an error or a time-out without a successor, which ends the mission."""


class BlockOutcome(msgspec.Struct, frozen=True):
    """Outcome of a block that has ended, or for which an edge has the successor."""

    kind: OutcomeKind
    error: str = ""
    """Kind of an error, such as `blocked`, or "" for any error, which has the general error successor."""
    branch: int | None = None
    """Index of a Decision's case, or of a Fork's successor."""

    @property
    def label(self) -> str:
        """Its text in progress events, counter-examples and messages: `error:blocked`."""
        if self.error:
            return f"{self.kind}:{self.error}"
        return str(self.kind) if self.branch is None else f"{self.kind}:{self.branch}"


SUCCESS: Final = BlockOutcome(OutcomeKind.OK)
TIMED_OUT: Final = BlockOutcome(OutcomeKind.TIMEOUT)
ANY_ERROR: Final = BlockOutcome(OutcomeKind.ERROR)
"""Outcome of the general error successor."""
BARRIER_BROKEN: Final = BlockOutcome(OutcomeKind.ERROR, "broken")
"""A needed member will not arrive at the barrier."""
UNKNOWN_VALUE: Final = BlockOutcome(OutcomeKind.ERROR, "unknown_value")
"""The condition of a Decision has no value."""
CRASHED: Final = BlockOutcome(OutcomeKind.ERROR, "crashed")
"""A block raised an exception that is not a BlockError."""
PREEMPTED: Final = BlockOutcome(OutcomeKind.ERROR, "preempted")
"""The block cannot continue after its mission was suspended."""
SUSPENDED: Final = BlockOutcome(OutcomeKind.SUSPENDED)
CANCELLED: Final = BlockOutcome(OutcomeKind.CANCELLED)
ABANDONED: Final = BlockOutcome(OutcomeKind.ABANDONED)
FAILS: Final = BlockOutcome(OutcomeKind.FAILS)
