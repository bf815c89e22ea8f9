"""Reports of beacons that another key has signed: of members alone, whose key is known."""

from pathlib import Path

import pytest

from swarmd.broker.config import Config
from swarmd.broker.contradictions import KEY, ContradictionReports
from swarmd.broker.core.action import ReportImpersonation
from swarmd.broker.core.beacon.beacon import PlatformCode
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.former_state import FormerState
from swarmware.model.names import hardware_id
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm
from swarmware.types.net import Denial


@pytest.mark.parametrize(("name", "count"), [("uav2", 1), ("uav9", 0)])
async def test_a_key_is_reported_as_another_one_where_the_roster_has_one(
    tmp_path: Path, name: str, count: int
) -> None:
    make_swarm(tmp_path, ("uav1", "uav2"))
    identity = NodeIdentity(hardware_id("uav1"), "uav1", "main", PlatformCode.UAV, 1, b"")
    core = BrokerCore(
        identity, Config(), 1, connections=True, former=FormerState(), now_ns=0, chance=lambda: 0.5
    )
    core.add_members(["uav2"], 0)
    found: list[Denial] = []
    reports = ContradictionReports(core, Keys.load(tmp_path / "uav1", "uav1"), DenialReporter(found.append))
    reports.on_impersonation(ReportImpersonation(hardware_id(name), ("10.0.0.9",), is_first=True), 0)
    assert len(found) == count
    for denial in found:
        assert (denial.platform, denial.verb) == ("10.0.0.9", KEY)
        assert denial.reason.startswith("a beacon of uav2 from 10.0.0.9")
