"""Reports denials as they are due: at once, or with those that came in the second after."""

import asyncio
from collections.abc import Callable

from swarmware.transport.security.denials import DenialReports
from swarmware.types.net import Denial


class DenialReporter:
    """Passes denials on at a limited rate; none is missing in their numbers, also when no further one
    comes."""

    def __init__(self, report: Callable[[Denial], None]) -> None:
        self._report = report
        self._reports = DenialReports()
        self._timer: asyncio.TimerHandle | None = None

    def on_denial(self, denial: Denial, now_ns: int) -> None:
        """Takes a denial; needs a running event loop."""
        report = self._reports.report(denial, now_ns)
        if report is not None:
            self._report(report)
        self._wait(now_ns)

    def _wait(self, now_ns: int) -> None:
        if self._timer is None and (deadline_ns := self._reports.deadline_ns()) is not None:
            wait_s = (deadline_ns - now_ns) / 1e9
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._on_timer, deadline_ns)

    def _on_timer(self, deadline_ns: int) -> None:
        self._timer = None
        for report in self._reports.due(deadline_ns):
            self._report(report)
        self._wait(deadline_ns)

    def close(self) -> None:
        """Ends the reports of denials."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
