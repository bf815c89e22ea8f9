"""New values of one resource or of many, as they arrive."""

from typing import Any

import msgspec

from swarmctl.resources.fields import attitudes, flow, shown_fields, with_unit
from swarmctl.resources.limits import thinning
from swarmctl.resources.listing import is_pattern, valued
from swarmctl.resources.owner_counter import OwnerCounters, is_numbered
from swarmctl.resources.rate_meter import RateMeter
from swarmctl.resources.subscription import ValueArrival, ValueSubscription
from swarmctl.resources.values import select
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import utc_text
from swarmware.errors import Partial
from swarmware.model.names import split_field
from swarmware.types.tree import TreeEntry
from swarmware.types.units import unit_of

WINDOW_S = 5.0
"""Window of the shown rate, long enough for a stable rate of a resource at 1 Hz."""


class WatchedValue(msgspec.Struct, frozen=True):
    """One new value of a watched resource."""

    path: str
    type: str
    stamp_ns: int | None
    """Stamp on the hardware clock of the owner."""
    age_s: float | None
    value: Any
    """Plain value, without the Struct of a single field."""
    utc_ns: int | None = None
    """Stamp on the wall clock of this machine, or None if the owner's clock is not known here."""
    unit: str = ""
    written_hz: float | None = None
    """Rate at which the owner has written the newest values, or None until it is known."""
    here_hz: float | None = None
    """Rate of the arrivals here, or None until it is known."""
    angles: dict[str, dict[str, float]] = {}
    """Roll, pitch and yaw in degrees of each quaternion, by the name before its components."""


async def print_changes(
    session: Session, path: str, count: int | None, names: tuple[str, ...] = (), history: bool = False
) -> None:
    """Prints each new value of the resources or their fields, `count` values or without an end if it is None.

    `history`: print also former values of boards, which arrive after an outage.

    Raises: Partial when values were overwritten before they were read.
    """
    name, fields = split_field(path)
    entries = await valued(session, name)
    news = await ValueSubscription.open(session, entries, history=history)
    meters = {e.path: RateMeter(WINDOW_S, numbered=is_numbered(session, e)) for e in entries}
    session.module.start(_count(session, entries, meters), "count at the owners")
    # resources whose thinning was explained: once is enough
    explained: set[str] = set()
    printed = 0
    async for new in news:
        meter = meters[new.path]
        # stored and late values would distort the rate of the arrivals
        if new.arrived and not new.late:
            meter.add(new.observation)
        value = select(new.value, new.path, fields, names)
        shown = WatchedValue(
            new.path,
            new.entry.type,
            new.frame.stamp_ns,
            new.age_s,
            value,
            news.utc_ns(new),
            _unit(new, fields, names),
            meter.written_hz,
            meter.here_hz,
            {name: angles._asdict() for name, angles in attitudes(value).items()},
        )
        if session.settings.structured:
            session.out.line(shown)
        else:
            for line in _lines(shown, session.out.width, with_path=is_pattern(session.path(name))):
                session.out.now(line)
        if meter.thinned and new.path not in explained:
            explained.add(new.path)
            session.out.say(await thinning(session, new.entry, meter))
        printed += 1
        if printed == count:
            break
    if news.lost:
        raise Partial(
            f"{name}: {news.lost} values were lost on the way, or overwritten before they were read"
        )


async def _count(session: Session, entries: list[TreeEntry], meters: dict[str, RateMeter]) -> None:
    """Reads the counters of the owners once per window."""
    counters = OwnerCounters(session, entries)
    async for _ in session.module.every(WINDOW_S / 2):
        for path, counted_hz in (await counters.rates_hz()).items():
            meters[path].counted_hz = counted_hz
        await counters.begin()


def _unit(new: ValueArrival, fields: str, names: tuple[str, ...]) -> str:
    """Unit of a single value or of one selected field."""
    chosen = ".".join([*filter(None, [fields]), *names[:1]])
    if len(names) > 1:
        return ""
    return unit_of(chosen.rpartition(".")[2]) if chosen else new.entry.unit


def _lines(new: WatchedValue, width: int | None, *, with_path: bool) -> list[str]:
    """Time, age and rate, then the path if there are several resources, then the value."""
    when = "-" if new.utc_ns is None else utc_text(new.utc_ns)
    age = "-" if new.age_s is None else f"{new.age_s:.3f} s"
    rate = "-" if new.here_hz is None else f"{new.here_hz:.1f} Hz"
    head = f"{when:<24}  {age:>8}  {rate:>8}  "
    rows = [("", new.path)] if with_path else []
    if isinstance(new.value, dict):
        rows += shown_fields(new.value)
    else:
        rows.append(("", with_unit(new.value, new.unit)))
    return flow(rows, width, head)
