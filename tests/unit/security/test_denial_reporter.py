"""The number of denials is complete: what came after a report follows without a further denial."""

import asyncio

from tests.patience import PATIENCE_S

from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.denials import REPORT_NS
from swarmware.types.net import Denial

REFUSED = Denial("uav2", "node", "call", "cmd/goto", 1, "no")


async def test_denials_after_report_are_reported_later() -> None:
    found: asyncio.Queue[Denial] = asyncio.Queue()
    reporter = DenialReporter(found.put_nowait)
    now_ns = 5 * REPORT_NS
    for number in range(500):
        reporter.on_denial(REFUSED, now_ns + number)
    assert found.get_nowait().count == 1
    assert found.empty()
    async with asyncio.timeout(PATIENCE_S):
        assert (await found.get()).count == 499
    assert reporter._timer is None, "nothing is left to report"


async def test_a_closed_one_reports_nothing_more() -> None:
    found: list[Denial] = []
    reporter = DenialReporter(found.append)
    for number in range(2):
        reporter.on_denial(REFUSED, REPORT_NS + number)
    reporter.close()
    assert reporter._timer is None
    assert [one.count for one in found] == [1]
