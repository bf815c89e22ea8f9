"""Rules of channels by resource pattern and link, from the file and from operators."""

from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.errors import InvalidInput, NotFound, OutOfRange
from swarmware.model import names
from swarmware.model.compression import Compression, Method
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import (
    NO_SETTINGS,
    SETTING_NAMES,
    SPAN_MAX_S,
    ChannelLimit,
    ChannelLimits,
    ChannelProtocol,
    ChannelRefusal,
    ChannelSettings,
    SetChannel,
    check_rule_names,
    merged,
    rate_rule,
    settings_of,
)
from swarmware.types.net import BoardPublication
from swarmware.types.tree import Quality, TreeList, TreeListing

UNDO_LIMIT: Final = 32
"""Changes that can be taken back."""
RULES_LIMIT: Final = 200
"""Rules of operators: each is compared with each path."""
_IMAGE: Final = "Image"
_VIDEO: Final = "sys/video/start"
"""Command of the service that sends video."""
NO_RESOURCE: Final = "no resource here matches it at present; the rule holds for those that come"
_UNLIMITED: Final = {
    Kind.COMMAND: "each message is delivered",
    Kind.FILE: "files take what all other channels leave",
    Kind.BRANCH: "it has no values",
}


class KeptRule(msgspec.Struct, frozen=True):
    """Settings of operators for one pattern and link."""

    settings: ChannelSettings
    ends_ns: int | None = None
    former: ChannelSettings | None = None
    """Settings that apply again after the end, or None if there were no settings."""


KeptRules = tuple[tuple[str, str, KeptRule], ...]
"""Rules with their pattern and link, the newest first."""


class KeptChannels(msgspec.Struct, frozen=True):
    """Rules of operators with what can be taken back, as they outlive the broker."""

    boot_id: int
    """Start of the computer to which the ends belong."""
    rules: KeptRules
    before: tuple[KeptRules, ...]
    """The rules before each of the last changes, the newest change last."""


_Key = tuple[str, str]
"""Pattern and link of a rule."""


class ChannelTable:
    """Rules of channels; for each setting, the first that matches and has it applies."""

    def __init__(self, file_rules: Iterable[ChannelLimit] = ()) -> None:
        self._file_rules = tuple(file_rules)
        self._rules: dict[_Key, KeptRule] = {}
        """Rules of operators, the newest first."""
        self._before: list[dict[_Key, KeptRule]] = []
        """The rules before each of the last changes."""
        self.version = 0
        """Incremented by each change."""

    def set(self, request: SetChannel, now_ns: int) -> None:
        """Sets, changes or removes the rule for a pattern and a link.

        Raises: OutOfRange, InvalidInput when a setting, the time or a name is invalid.
        """
        check_rule_names(request.pattern, request.link)
        request.settings.check()
        if not 0 <= request.for_s <= SPAN_MAX_S:
            raise OutOfRange(f"for_s {request.for_s}: expected 0 to {SPAN_MAX_S:g} seconds")
        key = (request.pattern, request.link)
        present = self._rules.get(key)
        settings = NO_SETTINGS
        if request.settings != NO_SETTINGS or request.unset:
            before = present.settings if present is not None else NO_SETTINGS
            settings = merged(before, request.settings, request.unset)
        if present is None and len(self._rules) >= RULES_LIMIT:
            raise OutOfRange(f"{RULES_LIMIT} rules are set: expected fewer; `traffic clear` removes them")
        # the newest rule comes first, because the first match applies
        rules = {other: rule for other, rule in self._rules.items() if other != key}
        if settings != NO_SETTINGS:
            rules = {key: _timed(settings, request.for_s, present, now_ns), **rules}
        self._change(rules)

    def undo(self, now_ns: int) -> None:
        """Takes back the last change that is still in force.

        Raises: NotFound without such a change.
        """
        self.advance(now_ns)
        # a change whose time is over changes nothing any more; an earlier one is undone
        while self._before:
            rules = _in_force(self._before.pop(), now_ns)
            if list(rules.items()) != list(self._rules.items()):
                self._rules = rules
                self.version += 1
                return
        raise NotFound("channels: no change by an operator is left to take back")

    def clear(self, pattern: str) -> None:
        """Removes the rules of operators with this pattern, or all rules of operators for "".

        Raises: NotFound without such a rule.
        """
        kept = {key: rule for key, rule in self._rules.items() if pattern and key[0] != pattern}
        if len(kept) == len(self._rules):
            raise NotFound(f"channels: no operator has set a rule{f' for {pattern!r}' if pattern else ''}")
        self._change(kept)

    def _change(self, rules: dict[_Key, KeptRule]) -> None:
        self._before = [*self._before[-UNDO_LIMIT + 1 :], self._rules]
        self._rules = rules
        self.version += 1

    def advance(self, now_ns: int) -> None:
        """Ends rules whose time is over."""
        if all(rule.ends_ns is None or rule.ends_ns > now_ns for rule in self._rules.values()):
            return
        self._rules = _in_force(self._rules, now_ns)
        self.version += 1

    def kept(self, boot_id: int) -> KeptChannels:
        """State that outlives the broker."""
        return KeptChannels(boot_id, _listed(self._rules), tuple(map(_listed, self._before)))

    def restore(self, kept: KeptChannels, boot_id: int, now_ns: int) -> None:
        """Takes the rules of the broker before this one. After a start of the computer no time can be
        judged: rules with an end are over then.

        Raises: InvalidInput, OutOfRange for a rule that is invalid; nothing has changed then.
        """
        # ends are instants of the monotonic clock, which starts again with the computer
        is_same = kept.boot_id == boot_id
        rules = _rules_of(kept.rules, with_ends=is_same)
        before = [_rules_of(one, with_ends=is_same) for one in kept.before]
        self._rules, self._before = rules, before[-UNDO_LIMIT:]
        self.version += 1
        self.advance(now_ns)

    def max_hz(self, path: str) -> float | None:
        """Rate limit of a local path towards all platforms, or None if no rule sets one."""
        return settings_of(self._all(None), path).max_hz

    def board_max_hz(self, board: BoardPublication) -> float | None:
        """Rate of a board in beacons, or None if no rule of channels decides it; words of operators precede
        the file."""
        found = rate_rule(self._all(None), board.path)
        return None if found is None or (found.from_file and board.is_ruled) else found.settings.max_hz

    def limits(self, now_ns: int) -> ChannelLimits:
        """All present rules, for the tree and for reports."""
        return ChannelLimits(self._all(now_ns))

    def _all(self, now_ns: int | None) -> tuple[ChannelLimit, ...]:
        return (
            *(
                ChannelLimit(pattern, rule.settings, _remaining_s(rule, now_ns), link)
                for (pattern, link), rule in self._rules.items()
            ),
            *self._file_rules,
        )


def _in_force(rules: dict[_Key, KeptRule], now_ns: int) -> dict[_Key, KeptRule]:
    """The rules without those whose time is over, in place of which the former settings apply."""
    found: dict[_Key, KeptRule] = {}
    for key, rule in rules.items():
        if rule.ends_ns is None or rule.ends_ns > now_ns:
            found[key] = rule
        elif rule.former is not None:
            found[key] = KeptRule(rule.former)
    return found


def _listed(rules: dict[_Key, KeptRule]) -> KeptRules:
    return tuple((pattern, link, rule) for (pattern, link), rule in rules.items())


def _rules_of(kept: KeptRules, *, with_ends: bool) -> dict[_Key, KeptRule]:
    found: dict[_Key, KeptRule] = {}
    for pattern, link, rule in kept[:RULES_LIMIT]:
        check_rule_names(pattern, link)
        rule.settings.check()
        if rule.former is not None:
            rule.former.check()
        if with_ends or rule.ends_ns is None:
            found[pattern, link] = rule
        elif rule.former is not None:
            found[pattern, link] = KeptRule(rule.former)
    return found


def _timed(settings: ChannelSettings, for_s: float, present: KeptRule | None, now_ns: int) -> KeptRule:
    if not for_s:
        return KeptRule(settings)
    former = None
    # a limited rule on top of another limited one returns to the settings before both
    if present is not None:
        former = present.settings if present.ends_ns is None else present.former
    return KeptRule(settings, now_ns + round(for_s * 1e9), former)


def _remaining_s(rule: KeptRule, now_ns: int | None) -> float | None:
    return None if rule.ends_ns is None or now_ns is None else (rule.ends_ns - now_ns) / 1e9


def refusals(
    request: SetChannel, resources: Iterable[Resource], present: Iterable[ChannelLimit] = ()
) -> tuple[ChannelRefusal, ...]:
    """Resources to which a change does not apply, each with the reasons. `present`: the rules in force.

    Raises: InvalidInput when it applies to none of those that match, and one does.
    """
    rules = tuple(present)
    rule = ChannelLimit(request.pattern, request.settings)
    given = {name for name in SETTING_NAMES if getattr(request.settings, name) is not None}
    # an application may have an inbox at the path of its board: the board is the resource
    ordered = sorted(resources, key=lambda one: one.kind is not Kind.COMMAND)
    matching = {one.path: one for one in ordered if rule.matches(one.path, "")}
    if given and not matching and not request.settings.is_video:  # it may be a source of video
        return (ChannelRefusal(request.pattern, NO_RESOURCE),)
    found, applies = [], not matching or not given
    if request.settings.is_video and not request.link:
        raise InvalidInput(f"pattern {request.pattern!r}: video goes to platforms; expected --link")
    if request.settings.is_video and all(one.path != _VIDEO for one in ordered):
        raise InvalidInput("protocol rtp: the service `video` does not run here; expected it in node.toml")
    for resource in matching.values():
        protocol = request.settings.protocol or settings_of(rules, resource.path).protocol
        reasons = _reasons(request.settings, request.link, resource, protocol)
        refused = {name: reason for name, reason in reasons.items() if name in given}
        applies |= len(refused) < len(given)
        if refused:
            found.append(ChannelRefusal(resource.path, "; ".join(dict.fromkeys(refused.values()))))
    if not applies:
        first = ", ".join(f"{one.path} ({one.reason})" for one in found[:3])
        raise InvalidInput(f"pattern {request.pattern!r}: matches only what cannot be set so: {first}")
    # a pattern such as `**` names no command, and a list of all of them hides the rest
    return tuple(one for one in found if matching[one.path].kind not in _UNLIMITED)


def _reasons(
    settings: ChannelSettings, link: str, resource: Resource, protocol: ChannelProtocol | None
) -> dict[str, str]:
    """Settings that cannot hold for a resource, with the reason."""
    kind = resource.kind
    if kind in _UNLIMITED:
        return dict.fromkeys(SETTING_NAMES, _UNLIMITED[kind])
    reasons: dict[str, str] = {}
    in_beacons = kind is Kind.BOARD and (
        resource.link == "tick" if protocol is None else protocol == ChannelProtocol.UDP
    )
    if in_beacons and link:
        return dict.fromkeys(SETTING_NAMES, "its beacons go to all neighbours, not over one link")
    if in_beacons:
        if settings.adaptive:
            text = "beacons carry its newest value at their own rate; with --protocol zmq it follows the link"
            reasons["max_hz"] = reasons["adaptive"] = text
        reasons["compression"] = "values in beacons are packed already"
        reasons["priority"] = "beacons take the values that have waited longest first"
        text = "a beacon has only its newest value; with --protocol zmq a buffer keeps former ones"
        reasons["buffer_bytes"] = reasons["buffer_s"] = text
    if settings.is_video:
        reasons["buffer_bytes"] = reasons["buffer_s"] = "what is late of a video is left out"
        reasons["priority"] = "packets of a video go after commands and before streams"
        if kind is not Kind.STREAM or resource.type != _IMAGE:
            text = f"video is for streams of type {_IMAGE}, not for a {kind} of {resource.type}"
            reasons["protocol"] = reasons["compression"] = text
        return reasons
    if kind is Kind.EVENT and settings.adaptive:
        reasons["max_hz"] = reasons["adaptive"] = "no event is left out; each waits until the link carries it"
    if kind is not Kind.BOARD:
        reasons["protocol"] = f"items of kind {kind} are acknowledged, which beacons are not"
    elif link:
        reasons["protocol"] = "the protocol holds for all links"
    if kind is Kind.SETTING:
        reasons["buffer_bytes"] = reasons["buffer_s"] = "only its newest value waits"
    compression = Compression.parse(settings.compression or str(Method.NONE))
    if compression.method is Method.JPEG and resource.type != _IMAGE:
        reasons["compression"] = f"JPEG is for values of type {_IMAGE}, not {resource.type}"
    return reasons


QUESTION: Final = TreeList("/*/sys/video/open")
"""Asks the tree of this node which platforms have the address at which they agree to receive video."""
_REASON: Final = "the service `video` does not run there: no value arrives; expected it in node.toml"


def without_video(request: SetChannel, own: str, listing: TreeListing) -> tuple[ChannelRefusal, ...]:
    """Platforms of the link that are in reach and cannot receive video; those with unknown resources are not
    among them.

    Raises: InvalidInput when none of the link that is in reach can.
    """
    rule = ChannelLimit(request.pattern, request.settings, link=request.link)
    able = {names.split(entry.path)[0] for entry in listing.entries if entry.quality != Quality.LOST}
    reached = {
        one.platform: one.platform in able or not one.digest
        for one in listing.platforms
        if one.reachable and one.platform != own and rule.is_to(one.platform)
    }
    unable = sorted(platform for platform, is_able in reached.items() if not is_able)
    if unable and not any(reached.values()):
        raise InvalidInput(f"link {request.link!r}: {', '.join(unable)}: {_REASON}")
    return tuple(ChannelRefusal(f"/{platform}", _REASON) for platform in unable)
