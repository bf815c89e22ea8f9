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


class DenialReports:
    """Decides which denials are reported."""

    def __init__(self) -> None:
        self._reported: dict[tuple[str, str, str, str], tuple[int, int]] = {}
        self._burst_ns = -REPORT_NS
        self._burst = 0

    def report(self, denial: Denial, now_ns: int) -> Denial | None:
        """The report that is due now, with the number of such denials since the last one; None: later."""
        key = denial.platform, denial.caller, denial.verb, denial.path
        is_new = key not in self._reported
        reported_ns, count = self._reported.pop(key, (now_ns - REPORT_NS, 0))
        if len(self._reported) >= REFUSALS_MAX:
            del self._reported[next(iter(self._reported))]
        if now_ns - reported_ns < REPORT_NS or (is_new and not self._may_begin(now_ns)):
            self._reported[key] = reported_ns, count + denial.count
            return None
        self._reported[key] = now_ns, 0
        return msgspec.structs.replace(denial, count=count + denial.count)

    def _may_begin(self, now_ns: int) -> bool:
        if now_ns - self._burst_ns >= REPORT_NS:
            self._burst_ns, self._burst = now_ns, 0
        self._burst += 1
        return self._burst <= NEW_BURST
