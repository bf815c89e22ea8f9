"""Reports of beacons that their senders have not signed."""

from pathlib import Path

import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.beacon.beacon import PlatformCode
from swarmd.broker.core.beacon.declared_period import RestartState
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.membership.sessions import ReportImpersonation
from swarmd.broker.records.forgery_reports import BEACON, KEY, ForgeryReports
from swarmware.model.names import hardware_id
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm
from swarmware.types.net import Denial


@pytest.mark.parametrize(("is_other_key", "verb"), [(True, KEY), (False, BEACON)])
async def test_false_beacon_is_reported_with_its_address(
    tmp_path: Path, is_other_key: bool, verb: str
) -> None:
    make_swarm(tmp_path, ("uav1", "uav2"))
    identity = NodeIdentity(hardware_id("uav1"), "uav1", "main", PlatformCode.UAV, 1, b"")
    core = BrokerCore(identity, Config(), 1, former=RestartState(), now_ns=0, chance=lambda: 0.5)
    core.add_members(["uav2"], 0)
    found: list[Denial] = []
    reports = ForgeryReports(core, Keys.load(tmp_path / "uav1", "uav1"), DenialReporter(found.append))
    reports.on_impersonation(ReportImpersonation(hardware_id("uav2"), "10.0.0.9", is_other_key), 0)
    [denial] = found
    assert (denial.platform, denial.verb) == ("10.0.0.9", verb)
    assert "uav2" in denial.reason
    assert "from 10.0.0.9" in denial.reason
