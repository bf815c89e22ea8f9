"""Reports of denials: a limited number, whatever an attacker invents, and none is lost from the count."""

from swarmware.transport.security.denials import NEW_BURST, REFUSALS_MAX, REPORT_NS, DenialReports
from swarmware.types.net import Denial


def denial(platform: str = "uav2", path: str = "cmd/goto", caller: str = "") -> Denial:
    return Denial(platform, "node", "call", path, 1, "no", caller)


def test_the_same_denial_is_reported_once_a_second_with_its_number() -> None:
    one = DenialReports()
    found = [one.report(denial(), step * REPORT_NS // 1000) for step in range(2001)]
    assert [report.count for report in found if report is not None] == [1, 1000, 1000]


def test_users_of_one_platform_are_reported_apart() -> None:
    one = DenialReports()
    for caller in ("anna", "bob"):
        report = one.report(denial(caller=caller), 0)
        assert report is not None
        assert report.caller == caller


def test_a_thousand_invented_names_make_few_reports_and_little_memory() -> None:
    one = DenialReports()
    found = [one.report(denial(f"10.0.{number}"), number) for number in range(1000)]
    assert sum(report is not None for report in found) == NEW_BURST
    assert len(one._reported) <= REFUSALS_MAX
    late = one.report(denial("10.0.999"), REPORT_NS)
    assert late is not None
    assert late.count == 2, "the one that was not reported counts"
