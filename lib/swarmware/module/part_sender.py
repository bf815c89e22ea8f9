"""Sends the parts of a large value, several at a time; all are delivered, or the value is not."""

import asyncio
from collections.abc import Iterator
from typing import Final, Protocol

from swarmware.model.frame import Frame
from swarmware.transport.delivery.outcome import Outcome, Status

UNDER_WAY: Final = 8
"""Parts without an answer at a time: 256 KiB, whatever the size of the value."""


class Messaging(Protocol):
    """Interface that sends one frame."""

    def send(self, frame: Frame, timeout_s: float) -> asyncio.Future[Outcome]:
        """Send a message; the future gets its outcome."""
        ...


async def send_parts(messaging: Messaging, parts: Iterator[Frame], timeout_s: float) -> Outcome:
    """The outcome of the value: the completing part's, or the first failed part's outcome."""
    loop = asyncio.get_running_loop()
    ends_s = loop.time() + timeout_s
    under_way: set[asyncio.Future[Outcome]] = set()
    newest = Outcome(Status.EXPIRED, detail="no part was sent")
    try:
        while True:
            while len(under_way) < UNDER_WAY and (part := next(parts, None)) is not None:
                under_way.add(messaging.send(part, max(0.0, ends_s - loop.time())))
            if not under_way:
                return newest
            ended, under_way = await asyncio.wait(under_way, return_when=asyncio.FIRST_COMPLETED)
            for one in ended:
                outcome = one.result()
                if not outcome:
                    return outcome
                # Parts are acknowledged out of order; the value is received with its last part.
                newest = max(newest, outcome, key=lambda each: each.received_ns)
    finally:
        # The other parts would only load the link: their outcomes are not awaited any more.
        for one in under_way:
            one.cancel()
