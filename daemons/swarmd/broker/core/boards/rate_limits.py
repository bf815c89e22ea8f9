"""Rate limits of channels: by resource pattern, set at run time."""

from collections.abc import Iterable
from typing import Final

from swarmware.errors import InvalidInput, OutOfRange
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind, Resource
from swarmware.types.net import ChannelLimit, ChannelLimits, SetChannel

PROMISED: Final = frozenset({Kind.STREAM, Kind.EVENT})
"""Kinds with guaranteed delivery of every item: rate limits do not apply to them."""


class _RateLimit:
    __slots__ = ("ends_ns", "max_hz", "pattern")

    def __init__(self, pattern: Pattern, max_hz: float, ends_ns: int | None) -> None:
        self.pattern = pattern
        self.max_hz = max_hz
        self.ends_ns = ends_ns


class RateLimits:
    """Rate limits by pattern; the newest matching one applies."""

    def __init__(self) -> None:
        self._limits: dict[str, _RateLimit] = {}
        self.version = 0
        """Incremented by each change."""

    def set(self, request: SetChannel, now_ns: int) -> None:
        """Sets, replaces or removes the limit of a pattern.

        Raises: InvalidInput when the pattern is invalid.
        """
        pattern = Pattern(request.pattern)
        self.version += 1
        self._limits.pop(request.pattern, None)
        if request.max_hz is None:
            return
        ends_ns = now_ns + round(request.for_s * 1e9) if request.for_s > 0 else None
        self._limits = {
            request.pattern: _RateLimit(pattern, max(request.max_hz, 0.0), ends_ns),
            **self._limits,
        }

    def max_hz(self, path: str) -> float | None:
        """Rate limit of a local path; None: unlimited."""
        for limit in self._limits.values():
            if limit.pattern.matches(path):
                return limit.max_hz
        return None

    def advance(self, now_ns: int) -> None:
        """Removes limits whose time is over."""
        over = [
            text
            for text, limit in self._limits.items()
            if limit.ends_ns is not None and limit.ends_ns <= now_ns
        ]
        for text in over:
            del self._limits[text]
            self.version += 1

    def limits(self, now_ns: int) -> ChannelLimits:
        """All present limits, for reports."""
        return ChannelLimits(
            tuple(
                ChannelLimit(
                    text, limit.max_hz, None if limit.ends_ns is None else (limit.ends_ns - now_ns) / 1e9
                )
                for text, limit in self._limits.items()
            )
        )


def unlimited_channels(request: SetChannel, resources: Iterable[Resource]) -> tuple[str, ...]:
    """Resources of this node that match a request and cannot be limited.

    Raises: OutOfRange, InvalidInput when the request does not fit the resources.
    """
    if request.max_hz is not None and not 0 <= request.max_hz <= 1000:
        raise OutOfRange(f"max_hz {request.max_hz}: expected 0..1000, or none to remove the limit")
    if not 0 <= request.for_s <= 86_400:
        raise OutOfRange(f"for_s {request.for_s}: expected 0..86400 seconds")
    pattern = Pattern(request.pattern)
    matching = [resource for resource in resources if pattern.matches(resource.path)]
    unlimited = tuple(resource.path for resource in matching if resource.kind in PROMISED)
    if request.max_hz is not None and unlimited and len(unlimited) == len(matching):
        raise InvalidInput(
            f"pattern {request.pattern!r}: matches only {', '.join(unlimited[:3])}, whose items are"
            " all delivered; expected boards: the owner of a stream sets its rate"
        )
    return unlimited
