"""The view of the rates of links and channels, redrawn once a period."""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from functools import partial
from typing import Final

import msgspec

from swarmctl.commandline.nodes import is_selection
from swarmctl.commands.traffic.limited import COLUMNS, limited, row
from swarmctl.commands.traffic.rates import ChannelRates, LinkRates, TrafficRates, rates
from swarmctl.resources.fanout import ask_all, warn_errors
from swarmctl.session.session import Session
from swarmctl.terminal.table import Cell, Column, fitted_table, show
from swarmware.errors import Partial, SwarmError
from swarmware.runtime.instant import until
from swarmware.types.channel import ChannelStates, ListChannels
from swarmware.types.net import UNACCEPTED
from swarmware.types.rpc import Empty
from swarmware.types.traffic import Traffic


class SortKey(StrEnum):
    """Columns by which channels and links are ordered, `name` ascending and the others descending."""

    BYTES = "bytes"
    OFFERED = "offered"
    SENT = "sent"
    RESENT = "resent"
    HELD = "held"
    DROPPED = "dropped"
    DELIVERED = "delivered"
    RECEIVED = "received"
    NAME = "name"


class TrafficTable(StrEnum):
    """Tables of the command."""

    LINKS = "links"
    CHANNELS = "channels"
    LIMITED = "limited"
    """Channels by notification whose rate is limited now; an empty table is not shown."""


_CHANNEL_KEYS: Final = {
    SortKey.BYTES: ("sent_bytes_s", "received_bytes_s"),
    SortKey.OFFERED: ("offered_hz",),
    SortKey.SENT: ("sent_hz",),
    SortKey.RESENT: ("repeated_hz",),
    SortKey.HELD: ("held_back_hz",),
    SortKey.DROPPED: ("dropped_hz",),
    SortKey.DELIVERED: ("delivered_hz",),
    SortKey.RECEIVED: ("received_hz",),
}
"""Fields whose sum orders the channels, by the key."""
_LINK_KEYS: Final = _CHANNEL_KEYS | {
    SortKey.RESENT: ("repeated_bytes_s",),
    SortKey.HELD: ("waiting_bytes",),
}


class TrafficTop:
    """The view of the rates: chosen tables in a chosen order."""

    def __init__(self, session: Session, sort: SortKey, parts: Sequence[TrafficTable]) -> None:
        self._session = session
        self._sort = sort
        self._parts = parts

    async def follow(self, period_s: float, count: int | None) -> None:
        """Prints the rates once per period, for `count` periods or without an end if it is None.

        Raises: as `Session.ask` when no platform answers; Partial when some platform did not answer in the
        last period.
        """
        session = self._session
        asked = await session.selected() if session.settings.node else [session.platform]
        before, errors = await self._traffic(asked)
        if not before:
            raise errors[asked[0]]
        clock = session.module.clock
        states = await self._states(asked)
        turn = 0
        while turn != count:
            # relative to the last reading: a period of the clock may end just after the command began
            await until(clock, clock.now_ns() + round(period_s * 1e9))
            now, errors = await self._traffic(asked)
            if not now and len(asked) == 1:
                raise errors[asked[0]]
            found = [
                rates(name, before[name], one)
                for name, one in now.items()
                # an equal time is the same reading, whose span would be zero
                if name in before and one.at_ns != before[name].at_ns
            ]
            now_states = await self._states(asked)
            found = [_with_limited(one, before[one.platform].at_ns, states, now_states) for one in found]
            # a platform that did not answer keeps its older reading, so its next rates span the gap
            before |= now
            states |= now_states
            # answers without a new reading do not count as a period
            if not found and now:
                continue
            turn += 1
            self._show([self._sorted(one) for one in found], last=turn == count)
            warn_errors(session, errors)
        if errors:
            raise Partial(f"traffic: {', '.join(errors)} did not answer")

    async def _traffic(self, asked: list[str]) -> tuple[dict[str, Traffic], dict[str, SwarmError]]:
        return await ask_all(self._session, asked, "sys/broker/traffic", Empty(), Traffic)

    async def _states(self, asked: list[str]) -> dict[str, ChannelStates]:
        """States of the channels by notification; nodes without a tree service are left out."""
        if TrafficTable.LIMITED not in self._parts:
            return {}
        found, _ = await ask_all(self._session, asked, "sys/tree/channels", ListChannels(), ChannelStates)
        return found

    def _sorted(self, found: TrafficRates) -> TrafficRates:
        # by name first: the next sort is stable, so equal rates do not change places
        channels = sorted(found.channels, key=lambda one: one.channel)
        links = sorted(found.links, key=lambda one: (one.platform, one.transport))
        if self._sort is not SortKey.NAME:
            channels.sort(key=partial(_sum, _CHANNEL_KEYS[self._sort]), reverse=True)
            links.sort(key=partial(_sum, _LINK_KEYS[self._sort]), reverse=True)
        return msgspec.structs.replace(found, channels=channels, links=links)

    def _show(self, found: list[TrafficRates], *, last: bool) -> None:
        """Prints a line per platform for programs, else tables, with a column of nodes for several nodes."""
        session, out = self._session, self._session.out
        if session.settings.structured:
            for one in found:
                out.line(one)
            return
        several = is_selection(session.settings.node)
        width = None if session.settings.output == "wide" else out.width
        sent = sum(one.sent_bytes_s for one in found) / 1000
        received = sum(one.received_bytes_s for one in found) / 1000
        again = sum(link.repeated_bytes_s for one in found for link in one.links) / 1000
        whose = f"{len(found)} nodes" if several else session.platform
        title = f"{whose}: {sent:.2f} kB/s out, {received:.2f} kB/s in, on the wire; {again:.2f} kB/s re-sent"
        texts = [title]
        for part in self._parts:
            columns = _COLUMNS[part]
            rows = [
                (*((one.platform,) if several else ()), *row) for one in found for row in _rows(part, one)
            ]
            if part is TrafficTable.LIMITED and not rows and len(self._parts) > 1:
                continue
            columns = (*((Column("NODE"),) if several else ()), *columns)
            cells = [[show(cell) for cell in row] for row in rows]
            table = fitted_table(columns, cells, width)
            texts.append(table.text if rows else f"no {part}")
            if rows and table.hidden:
                texts.append(f"-o wide also shows {', '.join(table.hidden)}")
        text = "\n\n".join(texts)
        if out.redraws:
            out.redraw(text, last=last)
        else:
            out.now(*text.split("\n"))


async def follow_rates(
    session: Session,
    period_s: float,
    count: int | None,
    sort: SortKey = SortKey.BYTES,
    parts: Sequence[TrafficTable] = tuple(TrafficTable),
) -> None:
    """Prints the rates of links and channels once per period. Raises: as `TrafficTop.follow`."""
    await TrafficTop(session, sort, parts).follow(period_s, count)


def _sum(fields: Sequence[str], one: ChannelRates | LinkRates) -> float:
    return float(sum(getattr(one, field) for field in fields))


def _right(name: str, drop: int = 0) -> Column:
    return Column(name, right=True, drop=drop)


_CHANNEL_COLUMNS: Final = (
    Column("CHANNEL"),
    _right("OFFERED /s"),
    _right("SENT /s"),
    _right("RE-SENT /s", 2),
    _right("HELD BACK /s", 3),
    _right("DROPPED /s"),
    _right("DELIVERED /s", 1),
    _right("kbit/s OUT"),
    _right("RECEIVED /s"),
    _right("kbit/s IN"),
)
_LINK_COLUMNS: Final = (
    Column("LINK"),
    Column("BY"),
    _right("OFFERED /s", 3),
    _right("SENT /s"),
    _right("RE-SENT kbit/s"),
    _right("WAITING"),
    _right("DROPPED /s"),
    _right("DELIVERED /s", 1),
    _right("kbit/s OUT"),
    _right("RECEIVED /s"),
    _right("LOST /s", 2),
    _right("kbit/s IN"),
)


_COLUMNS: Final = {
    TrafficTable.LINKS: _LINK_COLUMNS,
    TrafficTable.CHANNELS: _CHANNEL_COLUMNS,
    TrafficTable.LIMITED: COLUMNS,
}


def _with_limited(
    found: TrafficRates, since_ns: int, before: dict[str, ChannelStates], now: dict[str, ChannelStates]
) -> TrafficRates:
    """The rates with the rate-limited channels that their node reports."""
    states = now.get(found.platform)
    if states is None:
        return found
    channels = limited(before.get(found.platform), states, (found.at_ns - since_ns) / 1e9)
    return msgspec.structs.replace(found, limited=channels)


def _rows(part: TrafficTable, found: TrafficRates) -> Iterable[tuple[Cell, ...]]:
    if part is TrafficTable.LINKS:
        return map(_link_row, found.links)
    if part is TrafficTable.CHANNELS:
        return map(_channel_row, found.channels)
    return map(row, found.limited)


def _channel_row(one: ChannelRates) -> tuple[Cell, ...]:
    figures = (one.offered_hz, one.sent_hz, one.repeated_hz, one.held_back_hz, one.dropped_hz)
    return (
        one.channel,
        *map(_rate, figures),
        _rate(one.delivered_hz),
        _kbit_s(one.sent_bytes_s),
        _rate(one.received_hz),
        _kbit_s(one.received_bytes_s),
    )


def _link_row(one: LinkRates) -> tuple[Cell, ...]:
    return (
        "unaccepted" if one.platform == UNACCEPTED else one.platform,
        one.transport,
        _rate(one.offered_hz),
        _rate(one.sent_hz),
        _kbit_s(one.repeated_bytes_s),
        one.waiting_frames,
        _rate(one.dropped_hz),
        _rate(one.delivered_hz),
        _kbit_s(one.sent_bytes_s),
        _rate(one.received_hz),
        _rate(one.lost_hz),
        _kbit_s(one.received_bytes_s),
    )


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:.1f}"


def _kbit_s(bytes_s: float) -> str:
    return f"{bytes_s * 8 / 1000:.1f}"
