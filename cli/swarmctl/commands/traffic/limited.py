"""Channels whose rate is limited now, by a rule or by the capacity of the link."""

from typing import Final

import msgspec

from swarmctl.terminal.table import Cell, Column
from swarmware.types.channel import ChannelStates


class LimitedChannel(msgspec.Struct, frozen=True):
    """A channel by notification to one receiver, with its present rate limit."""

    channel: str
    receiver: str
    rate_hz: float
    """Rate limit at the end of the period."""
    reason: str
    held_back_hz: float
    """Rate of the values that were left out."""
    waiting: int
    """Values in the queue at the end of the period."""


COLUMNS: Final = (
    Column("LIMITED"),
    Column("TO"),
    Column("RATE Hz", right=True),
    Column("HELD BACK /s", right=True),
    Column("WAITING", right=True),
    Column("REASON", drop=1),
)


def limited(before: ChannelStates | None, now: ChannelStates, span_s: float) -> list[LimitedChannel]:
    """The channels with a limit, by name and receiver; the first reading counts no value as left out."""
    known = {(one.path, one.link): one.held_back for one in before.channels} if before is not None else {}
    found = []
    for one in now.channels:
        if one.rate_hz is not None:
            # a receiver that subscribes again has a new counter
            held = max(0, one.held_back - known.get((one.path, one.link), one.held_back))
            figures = (one.rate_hz, one.reason, held / span_s, one.waiting)
            found.append(LimitedChannel(one.path, one.link, *figures))
    return found


def row(one: LimitedChannel) -> tuple[Cell, ...]:
    """The cells of a channel, in the order of `COLUMNS`."""
    return (
        one.channel,
        one.receiver,
        f"{one.rate_hz:.1f}",
        f"{one.held_back_hz:.1f}",
        one.waiting,
        one.reason,
    )
