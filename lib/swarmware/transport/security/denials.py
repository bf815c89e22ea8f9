"""Reports of denials: each kind of refusal at a limited rate, with its number."""

from typing import Final

import msgspec

from swarmware.types.net import Denial

REPORT_NS: Final = 1_000_000_000
"""Minimum period between reports of the same refusal, with the count in between."""
REFUSALS_MAX: Final = 256
"""Kinds of refusal that are remembered; unknown computers can invent addresses without end."""
NEW_BURST: Final = 32
"""Kinds that are reported in one period for the first time; further ones wait for the next period."""

_Kind = tuple[str, str, str, str]


class _Refusal(msgspec.Struct, gc=False):
    """State of one kind of refusal."""

    denial: Denial
    """The newest one."""
    reported_ns: int
    """Instant from which the period until the next report counts."""
    count: int
    """Number since the last report."""


class DenialReports:
    """Decides which denials are reported."""

    def __init__(self) -> None:
        self._kinds: dict[_Kind, _Refusal] = {}
        self._burst_ns = -REPORT_NS
        self._burst = 0

    def report(self, denial: Denial, now_ns: int) -> Denial | None:
        """The report that is due now, with the count since the last one, or None if it is due later."""
        key = denial.platform, denial.caller, denial.verb, denial.path
        known = self._kinds.pop(key, None)
        if len(self._kinds) >= REFUSALS_MAX:
            # The first kind is the stalest, as each new denial moves its kind to the end.
            del self._kinds[next(iter(self._kinds))]
        if known is None:
            may_begin = self._may_begin(now_ns)
            known = _Refusal(denial, now_ns - REPORT_NS if may_begin else self._burst_ns, 0)
        self._kinds[key] = known
        known.denial = denial
        known.count += denial.count
        return _reported(known, now_ns) if now_ns - known.reported_ns >= REPORT_NS else None

    def deadline_ns(self) -> int | None:
        """Instant at which `due` has a report, or None if every denial was reported."""
        waiting = [one.reported_ns for one in self._kinds.values() if one.count]
        return min(waiting) + REPORT_NS if waiting else None

    def due(self, now_ns: int) -> list[Denial]:
        """Overdue reports of denials since their last report, at most `NEW_BURST` at a time."""
        late = [one for one in self._kinds.values() if one.count and now_ns - one.reported_ns >= REPORT_NS]
        for one in late[NEW_BURST:]:
            one.reported_ns = now_ns
        return [_reported(one, now_ns) for one in late[:NEW_BURST]]

    def _may_begin(self, now_ns: int) -> bool:
        if now_ns - self._burst_ns >= REPORT_NS:
            self._burst_ns, self._burst = now_ns, 0
        self._burst += 1
        return self._burst <= NEW_BURST


def _reported(kind: _Refusal, now_ns: int) -> Denial:
    count, kind.count, kind.reported_ns = kind.count, 0, now_ns
    return msgspec.structs.replace(kind.denial, count=count)
