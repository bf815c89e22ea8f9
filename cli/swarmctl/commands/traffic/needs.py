"""Needs of the resources of a platform, compared with the capacity of a link (S3.29)."""

from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from swarmctl.resources.listing import pages
from swarmctl.resources.newest import owned
from swarmctl.session.session import Session
from swarmctl.terminal.table import Detail, rows_of
from swarmware.errors import NotFound
from swarmware.model import names
from swarmware.model.compression import Method
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.channel import ChannelLimit, ChannelLimits, ChannelStates, ListChannels, settings_of
from swarmware.types.rpc import Empty
from swarmware.types.traffic import Traffic
from swarmware.types.tree import TreeEntry

VALUED: Final = frozenset({Kind.BOARD, Kind.STREAM, Kind.EVENT})


class ChannelNeed(msgspec.Struct, frozen=True):
    """Share of a link that one resource needs."""

    path: str
    kind: Kind
    written_hz: float
    value_bytes: float
    """Mean payload of a value."""
    written_bytes_s: float
    sent_bytes_s: float
    """Bytes per second with the rate and the compression that are set."""
    fair_hz: float | None = None
    """Rate in a max-min fair share of the link, or None if the present rate fits."""


class LinkNeeds(msgspec.Struct, frozen=True):
    """Needs of a platform's resources, and whether a link has room for them."""

    platform: str
    link: str
    """Receivers whose rules count, or "" for the rules for all receivers."""
    capacity_bytes_s: float
    """Capacity of the link as stated, else as measured."""
    measured_bytes_s: float | None
    """Capacity that the platform measured while the link was the limit, or None if never measured."""
    measured_s: float | None
    """Age of the measurement, or None without one."""
    written_bytes_s: float
    sent_bytes_s: float
    fits: bool
    channels: list[ChannelNeed]
    """Needs by resource, the largest first."""


def compare(
    entries: Iterable[TreeEntry],
    sizes: Mapping[str, float],
    limits: Iterable[ChannelLimit],
    ratios: Mapping[str, float],
    link: str,
    capacity_bytes_s: float,
) -> list[ChannelNeed]:
    """The needs by resource, with the rates at which all fit.

    `sizes`: bytes of a value; `ratios`: compressed by plain bytes of the values compressed up to now.
    """
    rules = tuple(limits)
    found = []
    for entry in entries:
        local = names.split(entry.path)[1]
        written_hz, size = entry.measured_hz or 0.0, sizes.get(local, 0.0)
        settings = settings_of(rules, local, link)
        sent_hz = written_hz if settings.max_hz is None else min(written_hz, settings.max_hz)
        is_compressed = settings.compression not in (None, Method.NONE)
        found.append(
            ChannelNeed(
                local,
                entry.kind,
                written_hz,
                size,
                written_hz * size,
                sent_hz * size * (ratios.get(local, 1.0) if is_compressed else 1.0),
            )
        )
    found.sort(key=lambda need: -need.sent_bytes_s)
    share = _fair_share([need.sent_bytes_s for need in found], capacity_bytes_s)
    return [
        need
        if share is None or need.sent_bytes_s <= share
        else msgspec.structs.replace(need, fair_hz=_sent_hz(need, rules, link) * share / need.sent_bytes_s)
        for need in found
    ]


def _sent_hz(need: ChannelNeed, rules: tuple[ChannelLimit, ...], link: str) -> float:
    max_hz = settings_of(rules, need.path, link).max_hz
    return need.written_hz if max_hz is None else min(need.written_hz, max_hz)


def _fair_share(needs: list[float], capacity: float) -> float | None:
    """Max-min fair limit of a need, with which all fit, or None if they fit without a limit."""
    if sum(needs) <= capacity:
        return None
    left, rest = capacity, len(needs)
    for need in sorted(needs):
        # needs below an equal share are met in full, and the larger ones divide the rest
        if need > left / rest:
            return left / rest
        left -= need
        rest -= 1
    return None


async def show_needs(session: Session, pattern: str, link: str, stated_bytes_s: float | None) -> None:
    """Prints the needs of matching resources and whether a link has room for them.

    `stated_bytes_s`: capacity of the link, or None for the measured one.
    Raises: NotFound when no matching resource is written, or the capacity is neither stated nor measured;
    as `Session.ask`.
    """
    target = session.platform
    traffic = await session.ask("sys/broker/traffic", Empty(), Traffic)
    measured = _measured(traffic, link)
    # a stated capacity wins: it may be of a link that does not exist yet
    capacity_bytes_s = stated_bytes_s if measured is None or stated_bytes_s is not None else measured[0]
    if capacity_bytes_s is None:
        raise NotFound(
            f"link {target} to {link}: its capacity is not measured, because it has not been the limit of"
            " frames in datagrams; expected --capacity"
        )
    listed = await pages(session, names.join(target, pattern), target)
    # without a measured rate nothing can be said about the need
    entries = [one for one in listed.entries if one.kind in VALUED and one.measured_hz]
    if not entries:
        raise NotFound(f"/{target}/{pattern}: matches no resource that is written at a rate")
    states = await session.ask("sys/tree/channels", ListChannels(), ChannelStates)
    board = await owned(session, names.join(target, "net/limits"))
    # the broker counts compressed bytes, so the newest value has the plain size of a compressed resource
    compressed = {one.path for one in states.compressions if one.plain_bytes}
    sizes = {
        one.channel: one.offered_bytes / one.offered_frames
        for one in traffic.channels
        if one.offered_frames and one.offered_bytes and one.channel not in compressed
    }
    for entry in entries:
        local = names.split(entry.path)[1]
        # compressed, or never offered to the broker because no other platform subscribes
        if local not in sizes:
            sizes[local] = float(len((await owned(session, entry.path)).data))
    ratios = {one.path: one.coded_bytes / one.plain_bytes for one in states.compressions if one.plain_bytes}
    limits = registry.decode(ChannelLimits, board.data).limits
    channels = compare(entries, sizes, limits, ratios, link, capacity_bytes_s)
    sent = sum(one.sent_bytes_s for one in channels)
    written = sum(one.written_bytes_s for one in channels)
    measured_bytes_s, measured_s = (None, None) if measured is None else measured
    fits = sent <= capacity_bytes_s
    found = LinkNeeds(
        target, link, capacity_bytes_s, measured_bytes_s, measured_s, written, sent, fits, channels
    )
    if session.settings.structured:
        session.out.document(found)
        return
    _show(session, found)


def _measured(traffic: Traffic, link: str) -> tuple[float, float] | None:
    """Capacity in bytes per second of the link to a neighbour, and how many seconds ago it was measured."""
    for one in traffic.links:
        if one.platform == link and one.capacity_bytes_s is not None:
            return one.capacity_bytes_s, (traffic.at_ns - one.capacity_ns) / 1e9
    return None


def _show(session: Session, found: LinkNeeds) -> None:
    details: list[Detail[ChannelNeed]] = [
        Detail("RESOURCE", value=lambda one: one.path),
        Detail("KIND", value=lambda one: str(one.kind), drop=1),
        Detail("WRITTEN /s", value=lambda one: f"{one.written_hz:.1f}", right=True),
        Detail("BYTES", value=lambda one: f"{one.value_bytes:.0f}", right=True),
        Detail("WRITTEN B/s", value=lambda one: f"{one.written_bytes_s:.0f}", right=True),
        Detail("SENT B/s", value=lambda one: f"{one.sent_bytes_s:.0f}", right=True),
        Detail(
            "% OF LINK",
            value=lambda one: f"{100 * one.sent_bytes_s / found.capacity_bytes_s:.1f}",
            right=True,
        ),
        Detail(
            "FITS AT Hz", value=lambda one: "" if one.fair_hz is None else f"{one.fair_hz:.1f}", right=True
        ),
    ]
    verdict = _verdict(found, found.capacity_bytes_s)
    if found.measured_bytes_s is not None and found.measured_s is not None:
        when = f"measured {found.measured_s:.0f} s ago"
        if found.measured_bytes_s == found.capacity_bytes_s:
            verdict = f"{verdict} ({when})"
        else:
            measured = f"{found.measured_bytes_s / 1000:.1f} kB/s, {_verdict(found, found.measured_bytes_s)}"
            verdict = f"{verdict}; {when}: {measured}"
    title = (
        f"{found.platform}: {found.written_bytes_s / 1000:.1f} kB/s are written,"
        f" {found.sent_bytes_s / 1000:.1f} kB/s sent to each receiver; a link of"
        f" {found.capacity_bytes_s / 1000:.1f} kB/s: {verdict}"
    )
    session.out.table(details, rows_of(details, found.channels), title)
    for one in found.channels:
        if one.fair_hz is not None:
            to = f" --link {found.link}" if found.link else ""
            path = f"/{found.platform}/{one.path}"
            session.out.say(f"it fits with: swarmctl traffic set {path}{to} --rate {one.fair_hz:.1f}hz")


def _verdict(found: LinkNeeds, capacity_bytes_s: float) -> str:
    return "fits" if found.sent_bytes_s <= capacity_bytes_s else "does not fit"
