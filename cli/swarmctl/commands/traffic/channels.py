"""Rules of channels, which are set, undone, removed, and shown with the state of the channels."""

from collections.abc import Iterable

import msgspec

from swarmctl.resources.limits import MISSION_STATE
from swarmctl.resources.newest import owned
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import rate_hz, size_bytes, span_s, spoken
from swarmctl.terminal.table import Detail, rows_of
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.model import names
from swarmware.model.compression import Compression
from swarmware.model.names import Pattern
from swarmware.types import registry
from swarmware.types.channel import (
    BEACON_LINK,
    NO_SETTINGS,
    RATE_MAX_HZ,
    SPAN_MAX_S,
    ChannelLimit,
    ChannelLimits,
    ChannelPriority,
    ChannelProtocol,
    ChannelRate,
    ChannelRefusal,
    ChannelSettings,
    ChannelState,
    ChannelStates,
    ClearChannels,
    CompressionState,
    ListChannels,
    SetChannel,
    UndoChannel,
)

AUTO = "auto"
"""Value of an option that clears it in the rule; as a rate, follow the capacity of the link."""
DEFAULT = "default"
"""Value of `--rate` that clears the rate in the rule."""
_NAMED = 3
"""Maximum paths that a warning names."""


class ChannelsView(msgspec.Struct, frozen=True):
    """Rules of a platform and the state of its channels."""

    platform: str
    limits: ChannelLimits
    states: ChannelStates


def change(
    rate: str | None, protocol: str | None, compress: str | None, buffer: str | None, priority: str | None
) -> tuple[ChannelSettings, tuple[str, ...]]:
    """The settings of options, and the names of the settings that the options clear.

    Raises: InvalidInput, OutOfRange for an option that is invalid.
    """
    found: dict[str, object] = {}
    unset: list[str] = []
    if rate == DEFAULT:
        unset.append("max_hz")
    elif rate is not None:
        kind_of, _, limit = rate.partition(":")
        # `auto:` without a limit is a typing error, which the parser of rates reports
        is_adaptive = kind_of == AUTO and rate != "auto:"
        found["max_hz"] = _max_hz((limit or "max") if is_adaptive else rate)
        if is_adaptive:
            found["adaptive"] = True
    for name, text, kind in (
        ("protocol", protocol, ChannelProtocol),
        ("priority", priority, ChannelPriority),
    ):
        if text == AUTO:
            unset.append(name)
        elif text is not None:
            found[name] = kind(text)
    if compress is not None:
        found["compression"] = str(Compression.parse(compress))
    if buffer == AUTO:
        unset += ["buffer_bytes", "buffer_s"]
    elif buffer is not None:
        for part in buffer.split("/"):
            is_size = part[-1:] in ("B", "b")
            name = "buffer_bytes" if is_size else "buffer_s"
            if name in found:
                raise InvalidInput(f"buffer {buffer!r}: expected a size, a time or both, such as 2MB/30s")
            found[name] = size_bytes(part) if is_size else span_s(part)
    settings = msgspec.structs.replace(NO_SETTINGS, **found)
    settings.check()
    return settings, tuple(unset)


def _max_hz(text: str) -> float:
    return RATE_MAX_HZ if text == "max" else rate_hz(text)


def duration_s(text: str) -> float:
    """The time of `--for`, or 0 for "", which keeps the rule until it is changed.

    Raises: InvalidInput, OutOfRange for a time outside the limits of a rule.
    """
    found_s = span_s(text) if text else 0.0
    if text and not 0 < found_s <= SPAN_MAX_S:
        raise OutOfRange(f"--for {text}: expected more than 0s, at most {SPAN_MAX_S / 3600:g}h")
    return found_s


def effect(request: SetChannel) -> str:
    """Effect of a change on the swarm that an operator must confirm, or "" if none is needed."""
    max_hz = request.settings.max_hz
    end = f"for {request.for_s:g} s" if request.for_s else "without an end"
    if max_hz == 0.0:
        return f"boards and streams that match {request.pattern} are not sent {end}"
    if max_hz is not None and max_hz < RATE_MAX_HZ and Pattern(request.pattern).matches(MISSION_STATE):
        return f"{MISSION_STATE} is sent at {max_hz:g} Hz at most {end}: barriers of a mission wait for it"
    return ""


async def set_channel(session: Session, request: SetChannel, *, yes: bool) -> None:
    """Sets channels and prints all rules. Raises: as `confirm` and `Session.ask`."""
    target = session.platform
    # before the confirmation: no question about a platform that cannot be asked
    await session.reach(target)
    await session.confirm(yes, effect(request))
    limits = await session.ask(names.join(target, "sys/broker/set_channel"), request, ChannelLimits)
    _show_refused(session, limits.refused)
    _show_rules(session, limits)


async def undo_channel(session: Session) -> None:
    """Undoes the last change of an operator and prints all rules. Raises: as `Session.ask`."""
    path = names.join(session.platform, "sys/broker/undo_channel")
    _show_rules(session, await session.ask(path, UndoChannel(), ChannelLimits))


async def clear_channels(session: Session, pattern: str) -> None:
    """Removes rules of operators and prints the others. Raises: as `Session.ask`."""
    path = names.join(session.platform, "sys/broker/clear_channels")
    _show_rules(session, await session.ask(path, ClearChannels(pattern), ChannelLimits))


async def list_channels(session: Session, pattern: str = "**") -> None:
    """Prints the rules, and for matching channels the rate in force, its origin and their state.

    Raises: as `Session.ask`.
    """
    target, wanted = session.platform, Pattern(pattern)
    # from the owner: a mirror would show the rules from before the last change
    found = await owned(session, names.join(target, "net/limits"))
    # the board changes with the rules only, so the remaining times in it are from then
    limits = _after(registry.decode(ChannelLimits, found.data), found.age_s or 0.0)
    states = await session.ask("sys/tree/channels", ListChannels(all=True), ChannelStates)
    shown = tuple(one for one in states.channels if wanted.matches(one.path))
    states = msgspec.structs.replace(states, channels=shown)
    if session.settings.structured:
        session.out.document(ChannelsView(target, limits, states))
        return
    _show_rules(session, limits)
    session.out.text("")
    channels: list[Detail[ChannelState]] = [
        Detail("CHANNEL", value=lambda one: one.path),
        Detail("LINK", value=lambda one: one.link),
        Detail("RATE", value=_rate_text, right=True),
        Detail("SET BY", value=lambda one: str(one.rate.source)),
        Detail("SET AT", value=lambda one: _place(one.rate)),
        Detail("SETTINGS", value=lambda one: str(one.settings), drop=3),
        Detail("REASON", value=lambda one: one.reason, drop=2),
        Detail("WAITING", value=lambda one: _counter(one, one.waiting), right=True),
        Detail("BYTES", value=lambda one: _counter(one, one.waiting_bytes), right=True, drop=1),
        Detail("DROPPED", value=lambda one: _counter(one, one.dropped), right=True),
        Detail("HELD BACK", value=lambda one: _counter(one, one.held_back), right=True),
    ]
    session.out.table(
        channels,
        rows_of(channels, states.channels),
        empty=f"{target}: no other platform subscribes to a matching resource",
    )
    if not states.compressions:
        return
    session.out.text("")
    details: list[Detail[CompressionState]] = [
        Detail("COMPRESSED", value=lambda one: one.path),
        Detail("BYTES", value=lambda one: one.plain_bytes, right=True),
        Detail("SENT AS", value=lambda one: one.coded_bytes, right=True),
        Detail(
            "SAVED %",
            value=lambda one: (
                f"{100 * (1 - one.coded_bytes / one.plain_bytes):.1f}" if one.plain_bytes else ""
            ),
            right=True,
        ),
        Detail("CPU s", value=lambda one: f"{one.spent_s:.2f}", right=True),
    ]
    session.out.table(details, rows_of(details, states.compressions))
    for one in states.compressions:
        if one.refused:
            session.out.warn(f"{one.path}: sent without its compression: {one.refused}")


def _rate_text(state: ChannelState) -> str:
    """The present limit of the rate, else the rate in force, or "" if every value is sent."""
    found_hz = state.rate.max_hz if state.rate_hz is None else state.rate_hz
    return "" if found_hz is None else f"{found_hz:.3g} Hz"


def _counter(state: ChannelState, count: int) -> int | None:
    """A count of values, or None for channels in beacons, of which only the broker has them."""
    return None if state.link == BEACON_LINK else count


def _place(rate: ChannelRate) -> str:
    """Node and pattern of the rule that decides a rate: `uav1 nav/* --link gcs`."""
    link = f"--link {rate.link}" if rate.link else ""
    return " ".join(filter(None, (rate.platform, rate.pattern, link)))


def _after(limits: ChannelLimits, age_s: float) -> ChannelLimits:
    """The rules of a board of this age, with their times reduced to the present remainder."""
    rules = [
        one
        if one.remaining_s is None
        else msgspec.structs.replace(one, remaining_s=max(0.0, one.remaining_s - age_s))
        for one in limits.limits
    ]
    return msgspec.structs.replace(limits, limits=tuple(rules))


def _show_refused(session: Session, refused: Iterable[ChannelRefusal]) -> None:
    by_reason: dict[str, list[str]] = {}
    for one in refused:
        by_reason.setdefault(one.reason, []).append(one.path)
    for reason, paths in by_reason.items():
        more = f" and {len(paths) - _NAMED} more" if len(paths) > _NAMED else ""
        session.out.warn(f"not for {', '.join(paths[:_NAMED])}{more}: {reason}")


def _show_rules(session: Session, limits: ChannelLimits) -> None:
    if session.settings.structured:
        session.out.document(limits)
        return
    details: list[Detail[ChannelLimit]] = [
        Detail("PATTERN", value=lambda rule: rule.pattern),
        Detail("LINK", value=lambda rule: rule.link or "all"),
        Detail("RATE", value=lambda rule: rule.settings.rate.replace("hz", " Hz"), right=True),
        Detail("PROTOCOL", value=lambda rule: rule.settings.protocol),
        Detail("COMPRESSION", value=lambda rule: rule.settings.compression),
        Detail("BUFFER", value=lambda rule: rule.settings.buffer),
        Detail("PRIORITY", value=lambda rule: rule.settings.priority),
        Detail(
            "LEFT",
            value=lambda rule: None if rule.remaining_s is None else spoken(rule.remaining_s),
            right=True,
        ),
        Detail("BY", value=lambda rule: "file" if rule.from_file else "operator", drop=1),
    ]
    empty = f"{session.platform}: no rule is set for channels"
    session.out.table(details, rows_of(details, limits.limits), empty=empty)
