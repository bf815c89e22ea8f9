"""What a member may do at another platform follows from its role on the roster."""

from pathlib import Path

import pytest
from tests.integration.broker.swarm import on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmware.errors import Denied
from swarmware.model.access import Role, Sender
from swarmware.transport.delivery.outcome import Status
from swarmware.types.net import Denial
from swarmware.types.scalar import Text


@on_uvloop
async def test_node_commands_no_other_platform_and_operator_does(tmp_path: Path) -> None:
    roles = {"uav1": "node", "uav2": "node", "gcs": "operator"}
    async with swarm(tmp_path, *roles, roles=roles) as cell:
        owner = cell["uav1"]
        box = owner.app.inbox("cmd/goto", Text)
        owner.app.serve("sys/vehicle/arm", Text, lambda request, _: request, reply=Text)
        owner.app.serve("plan/share", Text, lambda request, meta: Text(str(meta.sender)), reply=Text)
        denials = owner.app.stream_reader("net/denials", Denial)
        for name in ("uav2", "gcs"):
            await cell[name].until_up("uav1")

        refused = await cell["uav2"].app.send("/uav1/cmd/goto", Text("north"), timeout_s=PATIENCE_S)
        assert refused.status is Status.REFUSED
        assert "cmd/goto: node@uav2 may not call it; expected role operator" in refused.detail
        with pytest.raises(Denied, match="sys/vehicle/arm: node@uav2 may not call it"):
            await cell["uav2"].app.request("/uav1/sys/vehicle/arm", Text("on"), Text, timeout_s=PATIENCE_S)
        seen = [await denials.next(PATIENCE_S), await denials.next(PATIENCE_S)]
        assert {(one.platform, one.role, one.path) for one in seen} == {
            ("uav2", "node", "cmd/goto"),
            ("uav2", "node", "sys/vehicle/arm"),
        }
        assert (await owner.traffic()).refused.denied >= 2

        shared = await cell["uav2"].app.request("/uav1/plan/share", Text(""), Text, timeout_s=PATIENCE_S)
        assert shared.value == "node@uav2"
        for user, role, allowed in (("bob", Role.OBSERVER, False), ("anna", Role.MAINTAINER, True)):
            outcome = await cell["gcs"].app.send(
                "/uav1/cmd/goto", Text(user), timeout_s=PATIENCE_S, on_behalf_of=Sender("gcs", role, user)
            )
            assert bool(outcome) is allowed
            assert allowed or "bob@gcs (observer) may not call it" in outcome.detail
        assert (await box.next(PATIENCE_S)).value == "anna"
        assert box.meta is not None
        assert box.meta.sender == Sender("gcs", Role.OPERATOR, "anna"), "no more than its platform"
        assert await cell["gcs"].app.send("/uav1/cmd/goto", Text("south"), timeout_s=PATIENCE_S)
        assert (await box.next(PATIENCE_S)).value == "south"
        assert box.meta is not None
        assert box.meta.sender == Sender("gcs", Role.OPERATOR)
        assert await owner.app.send("cmd/goto", Text("own"), timeout_s=PATIENCE_S)
        assert (await box.next(PATIENCE_S)).value == "own"
        assert box.meta.sender is None
