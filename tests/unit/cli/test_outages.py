"""`swarmctl link outages`: what a person and a program read of the outages of a node."""

import pytest
from tests.unit.cli.session import ScriptedSession

from swarmctl.commands.link.outages import list_outages
from swarmware.types.outage import LinkOutage, OutageCause, OutagePhase, OutageTable

OVER = LinkOutage(
    "uav2",
    "main",
    7,
    1_700_000_000_000_000_000,
    OutageCause.SILENT,
    OutagePhase.OVER,
    detected_after_s=1.204,
    down_for_s=12.5,
    recovered_in_s=0.31,
    drained_in_s=2.0,
    backlog_frames=40,
    backlog_bytes=4000,
)
LOST = LinkOutage(
    "uav3", "fc", 8, 1_700_000_100_000_000_000, OutageCause.HALF_OPEN, OutagePhase.LOST, detected_after_s=7.0
)
FOUND = {"sys/broker/outages": OutageTable((LOST, OVER))}


async def test_each_outage_is_line_with_its_four_times() -> None:
    session = ScriptedSession(FOUND)
    await list_outages(session, None)
    _, lost, over = session.stdout.getvalue().splitlines()
    assert lost.split() == ["uav3.fc", "2023-11-14T22:15:00.000Z", "half_open", "lost", "7.00", *"---0"]
    assert over.split()[:1] + over.split()[2:] == [
        "uav2",
        "silent",
        "over",
        "1.20",
        "12.50",
        "0.31",
        "2.00",
        "40",
    ]


@pytest.mark.parametrize(("count", "names"), [(1, ["uav3"]), (5, ["uav3", "uav2"])])
async def test_the_newest_ones_can_be_asked_for(count: int, names: list[str]) -> None:
    session = ScriptedSession(FOUND, output="json")
    await list_outages(session, count)
    assert [one["platform"] for one in session.document["outages"]] == names


async def test_a_node_without_outages_says_so() -> None:
    session = ScriptedSession({"sys/broker/outages": OutageTable()})
    await list_outages(session, None)
    assert session.stdout.getvalue() == ""
    assert session.stderr.getvalue() == "gcs: no link was lost since it was up\n"
