"""Measured rates, bandwidths and delays of resources."""

import asyncio
from collections.abc import Callable

import msgspec

from swarmctl.resources.limits import thinning
from swarmctl.resources.listing import valued
from swarmctl.resources.owner_counter import OwnerCounters, is_numbered
from swarmctl.resources.rate_meter import RateMeter, Statistics
from swarmctl.resources.subscription import ValueSubscription
from swarmctl.session.session import Session
from swarmctl.terminal.table import Cell, Column
from swarmware.errors import NoAnswer, Partial
from swarmware.types.tree import TreeEntry


class MeasuredRate(msgspec.Struct, frozen=True):
    """Rate of one resource."""

    path: str
    values: int
    """Values that arrived here."""
    window_s: float
    """Time from the first to the last arrival."""
    written_hz: float | None
    """Rate at which the owner writes, by its counter and clock, or null before the second value."""
    here_hz: float | None
    """Rate of the arrivals at the joined node."""
    declared_hz: float
    """Rate of the template, or 0 for a resource without a period."""
    interval_s: Statistics | None
    """Times between two arrivals."""


class MeasuredRates(msgspec.Struct, frozen=True):
    """Rates of the measured resources."""

    rates: list[MeasuredRate]


class MeasuredBandwidth(msgspec.Struct, frozen=True):
    """Payload bytes of one resource, without headers; on a link they may be compressed."""

    path: str
    values: int
    window_s: float
    written_bytes_s: float | None
    """Bytes that the owner writes, its rate times the mean size, or null before the second value."""
    here_bytes_s: float | None
    """Bytes that arrive at the joined node."""
    size_bytes: Statistics | None


class MeasuredBandwidths(msgspec.Struct, frozen=True):
    """Bandwidths of the measured resources."""

    bandwidths: list[MeasuredBandwidth]


class MeasuredDelay(msgspec.Struct, frozen=True):
    """Time from the stamp of the values to their arrival at the joined node."""

    path: str
    values: int
    delay_s: Statistics | None
    """Delays of the values, or null if the owner's clock is not known here."""
    bound_s: float | None
    """Largest error of the conversion of the owner's clock, 0 for this node's own clock."""


class MeasuredDelays(msgspec.Struct, frozen=True):
    """Delays of the measured resources."""

    delays: list[MeasuredDelay]


class Measurement:
    """Values of some resources that arrived within a time."""

    def __init__(self, session: Session, entries: list[TreeEntry]) -> None:
        self.entries = entries
        self.meters = {e.path: RateMeter(numbered=is_numbered(session, e)) for e in entries}
        self.bounds_s: dict[str, float] = {}


async def measure(session: Session, pattern: str, duration_s: float) -> Measurement:
    """Subscribes to resources and takes what arrives within `duration_s` after the first value.

    Raises: NotFound, NoAnswer when nothing arrives.
    """
    found = Measurement(session, await valued(session, pattern))
    counters = OwnerCounters(session, found.entries)
    # before the subscription, so that the readings enclose the window
    await counters.begin()
    news = await ValueSubscription.open(session, found.entries)
    loop = asyncio.get_running_loop()
    began = False
    try:
        async with asyncio.timeout(session.settings.timeout_s + duration_s) as window:
            async for new in news:
                # the value that a board had before has no time of arrival
                if not new.arrived:
                    continue
                if not began:  # the subscription takes time, so the window begins with the first value
                    began = True
                    window.reschedule(loop.time() + duration_s)
                found.meters[new.path].add(new.observation)
                if new.bound_s is not None:
                    found.bounds_s[new.path] = max(found.bounds_s.get(new.path, 0.0), new.bound_s)
    except TimeoutError:
        pass
    for path, counted_hz in (await counters.rates_hz()).items():
        found.meters[path].counted_hz = counted_hz
    if not any(len(meter) for meter in found.meters.values()):
        raise NoAnswer(f"{pattern}: nothing arrived within {session.settings.timeout_s + duration_s:g} s")
    return found


def _raise_silent(pattern: str, found: Measurement) -> None:
    silent = [path for path, meter in found.meters.items() if not len(meter)]
    if silent:
        shown = ", ".join(silent[:3]) + (f" and {len(silent) - 3} more" if len(silent) > 3 else "")
        raise Partial(f"{pattern}: nothing arrived of {shown}")


async def print_rates(session: Session, pattern: str, duration_s: float) -> None:
    """Prints the rates of resources. Raises: as `measure`, Partial when nothing arrives of some."""
    found = await measure(session, pattern, duration_s)
    rates = [
        MeasuredRate(
            entry.path,
            len(meter),
            meter.span_s,
            meter.written_hz,
            meter.here_hz,
            entry.rate_hz,
            meter.intervals_s,
        )
        for entry, meter in _measured(found)
    ]
    if session.settings.structured:
        session.out.document(MeasuredRates(rates))
    else:
        columns = [
            Column("PATH"),
            Column("WRITTEN Hz", right=True),
            Column("HERE Hz", right=True),
            Column("DECLARED Hz", right=True, wide=True),
            *_columns("ms"),
            Column("VALUES", right=True, wide=True),
        ]
        rows = [
            (r.path, r.written_hz, r.here_hz, r.declared_hz or None, *_cells(r.interval_s, _ms), r.values)
            for r in rates
        ]
        session.out.table(columns, rows)
    for entry, meter in _measured(found):
        if meter.thinned:
            session.out.say(await thinning(session, entry, meter))
    _raise_silent(pattern, found)


async def print_bandwidths(session: Session, pattern: str, duration_s: float) -> None:
    """Prints the bandwidths of resources. Raises: as `print_rates`."""
    found = await measure(session, pattern, duration_s)
    widths = []
    for entry, meter in _measured(found):
        sizes, hz = meter.sizes_bytes, meter.written_hz
        # estimated: values that were left out on the way have the mean size of the others
        written = None if sizes is None or hz is None else sizes.mean * hz
        widths.append(
            MeasuredBandwidth(entry.path, len(meter), meter.span_s, written, meter.bytes_per_s, sizes)
        )
    if session.settings.structured:
        session.out.document(MeasuredBandwidths(widths))
    else:
        columns = [
            Column("PATH"),
            Column("WRITTEN B/s", right=True),
            Column("HERE B/s", right=True),
            *_columns("B"),
            Column("VALUES", right=True, wide=True),
        ]
        rows = [
            (w.path, w.written_bytes_s, w.here_bytes_s, *_cells(w.size_bytes, float), w.values)
            for w in widths
        ]
        session.out.table(columns, rows)
    _raise_silent(pattern, found)


async def print_delays(session: Session, pattern: str, duration_s: float) -> None:
    """Prints the delays of resources. Raises: as `print_rates`."""
    found = await measure(session, pattern, duration_s)
    delays = [
        MeasuredDelay(entry.path, len(meter), meter.delays_s, found.bounds_s.get(entry.path))
        for entry, meter in _measured(found)
    ]
    if session.settings.structured:
        session.out.document(MeasuredDelays(delays))
    else:
        columns = [
            Column("PATH"),
            *_columns("ms"),
            Column("BOUND ms", right=True),
            Column("VALUES", right=True, wide=True),
        ]
        rows = [
            (d.path, *_cells(d.delay_s, _ms), None if d.bound_s is None else _ms(d.bound_s), d.values)
            for d in delays
        ]
        session.out.table(columns, rows)
    for one in delays:
        if one.delay_s is None:
            session.out.warn(f"{one.path}: the clock of its owner is not known here; see `swarmctl time ls`")
    _raise_silent(pattern, found)


def _measured(found: Measurement) -> list[tuple[TreeEntry, RateMeter]]:
    return [(entry, found.meters[entry.path]) for entry in found.entries if len(found.meters[entry.path])]


def _columns(unit: str) -> list[Column]:
    return [Column(f"{name} {unit}", right=True) for name in ("MIN", "MEAN", "MAX", "STD")]


def _cells(found: Statistics | None, scaled: Callable[[float], float]) -> tuple[Cell, ...]:
    if found is None:
        return None, None, None, None
    return tuple(scaled(value) for value in (found.min, found.mean, found.max, found.std))


def _ms(seconds: float) -> float:
    return seconds * 1e3
