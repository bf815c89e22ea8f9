"""Reports of denials: a limited number, whatever an attacker invents, and none is lost from the count."""

from swarmware.transport.security.denials import NEW_BURST, REFUSALS_MAX, REPORT_NS, DenialReports
from swarmware.types.net import Denial


def denial(platform: str = "uav2", path: str = "cmd/goto", caller: str = "") -> Denial:
    return Denial(platform, "node", "call", path, 1, "no", caller)


def test_same_denial_is_reported_each_second_counted() -> None:
    one = DenialReports()
    found = [one.report(denial(), step * REPORT_NS // 1000) for step in range(2001)]
    assert [report.count for report in found if report is not None] == [1, 1000, 1000]


def test_users_of_one_platform_are_reported_apart() -> None:
    one = DenialReports()
    for caller in ("anna", "bob"):
        report = one.report(denial(caller=caller), 0)
        assert report is not None
        assert report.caller == caller


def test_thousand_invented_names_make_few_reports() -> None:
    one = DenialReports()
    found = [one.report(denial(f"10.0.{number}"), number) for number in range(1000)]
    assert sum(report is not None for report in found) == NEW_BURST
    assert len(one._kinds) <= REFUSALS_MAX
    late = one.report(denial("10.0.999"), REPORT_NS)
    assert late is not None
    assert late.count == 2, "the one that was not reported counts"


def test_denials_after_report_are_due_with_reason() -> None:
    one = DenialReports()
    assert one.deadline_ns() is None
    assert one.report(denial(), 0) is not None
    assert one.deadline_ns() is None
    for step in range(1, 500):
        assert one.report(denial(), step) is None
    assert one.deadline_ns() == REPORT_NS
    assert one.due(REPORT_NS - 1) == []
    assert [report.count for report in one.due(REPORT_NS)] == [499]
    assert one.due(9 * REPORT_NS) == []
    assert one.deadline_ns() is None


def test_some_invented_names_are_reported_each_period() -> None:
    one = DenialReports()
    for number in range(1000):
        one.report(denial(f"10.0.{number}"), number)
    now_ns, found = 0, 0
    while (deadline_ns := one.deadline_ns()) is not None:
        assert deadline_ns >= now_ns
        now_ns = deadline_ns
        reports = one.due(now_ns)
        assert len(reports) <= NEW_BURST
        found += len(reports)
    assert found == REFUSALS_MAX
    assert now_ns < 20 * REPORT_NS
