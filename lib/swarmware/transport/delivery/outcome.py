"""The outcome of a message, as reported to its sender."""

from enum import IntEnum
from typing import Final

import msgspec

ABSENT: Final = "no application here takes this path and type"
"""Reason of the refusal of a message or request to an address without a server."""

FULL: Final = "the inbox is full"
"""Reason of a temporary refusal: the sender repeats the message, and its outcome is expired at this hop."""


class Status(IntEnum):
    """Ends of a message; the value travels in `Ack.status`."""

    DELIVERED = 0
    """The message is in the inbox of the receiver."""
    REFUSED = 1
    """The receiver refuses it: it has no such inbox, or the payload does not match its type."""
    EXPIRED = 2
    """There was no answer before the time-out, or the inbox was full until then."""
    UNREACHABLE = 3
    """There was no route to the receiver, or the receiver has died."""
    ABSENT = 4
    """On the wire only: there is no such inbox yet. After the grace time the sender gets REFUSED."""


class Outcome(msgspec.Struct, frozen=True):
    """Outcome of one message."""

    status: Status
    where: str = ""
    """Hop at which it stopped, as platform or platform:application; the receiver when delivered."""
    detail: str = ""
    """Reason, when it was not delivered."""
    received_ns: int = 0
    """Receiver's hardware clock when it was put into the inbox."""

    @property
    def delivered(self) -> bool:
        """Whether the message is in the receiver's inbox."""
        return self.status is Status.DELIVERED

    def __bool__(self) -> bool:
        return self.delivered

    def __str__(self) -> str:
        text = self.status.name.lower()
        if self.where:
            text += f" at {self.where}"
        return f"{text}: {self.detail}" if self.detail else text
