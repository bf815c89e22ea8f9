"""Report of doctor on the outages of links."""

import pytest

from swarmctl.commands.doctor import joined_checks
from swarmctl.commands.doctor.joined_checks import check_outages, lost_links, unsteady_links
from swarmctl.commands.doctor.node_findings import ComputerFaults, NodeFindings
from swarmware.types.outage import LinkOutage, OutageCause, OutagePhase

S = 1_000_000_000
NOW_NS = 10_000 * S


def outage(platform: str, ago_s: float, phase: OutagePhase = OutagePhase.OVER) -> LinkOutage:
    down_for_s = None if phase is OutagePhase.LOST else 4.0
    began_ns = NOW_NS - round(ago_s * S)
    return LinkOutage(platform, "main", 1, began_ns, OutageCause.SILENT, phase, 1.0, down_for_s)


def told(monkeypatch: pytest.MonkeyPatch, *outages: LinkOutage) -> list[tuple[str, str]]:
    monkeypatch.setattr(joined_checks, "utc_ns", lambda: NOW_NS)
    found = check_outages(NodeFindings((ComputerFaults(""),), outages=outages))
    return [(one.verdict, one.text) for one in found]


def test_lost_links_are_named_longest_first() -> None:
    found = [outage("uav1", 5, OutagePhase.LOST), outage("uav3", 4), outage("uav2", 80, OutagePhase.LOST)]
    assert lost_links(found, NOW_NS) == ["uav2 for 80 s", "uav1 for 5 s"]


def test_repeatedly_lost_link_does_not_hold() -> None:
    found = [outage("uav1", ago_s) for ago_s in (10, 200, 599)] + [outage("uav2", 10)] * 2
    assert unsteady_links(found, NOW_NS) == ["uav1: 3 outages, 12 s in all"]
    assert unsteady_links([outage("uav1", ago_s) for ago_s in (10, 200, 601)], NOW_NS) == []


def test_one_outage_is_reported_several_are_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(monkeypatch) == []
    assert told(monkeypatch, outage("uav1", 5)) == [("ok", "links lost now: none (swarmctl link outages)")]
    ((verdict, text),) = told(monkeypatch, outage("uav2", 7, OutagePhase.LOST))
    assert (verdict, "uav2 for 7 s" in text) == ("ok", True)
    ((verdict, text),) = told(monkeypatch, *[outage("uav1", 5)] * 3)
    assert (verdict, "in the last 10 min: uav1: 3 outages, 12 s in all" in text) == ("warning", True)


def test_without_a_broker_nothing_is_told() -> None:
    assert list(check_outages(NodeFindings((ComputerFaults(""),)))) == []
