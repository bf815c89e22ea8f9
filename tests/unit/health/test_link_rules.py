"""The summary of a node's links is judged by the rules of the health monitor."""

import msgspec
from tests.unit.health.monitor import SECOND, look, monitor, present, told

from swarmware.model.resource import Resource
from swarmware.types.health import Phase
from swarmware.types.outage import NodeLinks

LINKS = Resource(path="net/links", type="NodeLinks", rate_hz=1)


def test_summary_of_links_is_judged_by_rules() -> None:
    core = monitor(grace_s=0.0)
    present(core, LINKS, app="broker")
    look(core, "net/links", 1, 0)
    rules = {rule.check: rule for rule in core.limits() if rule.path == "net/links"}
    fields = {field.name for field in msgspec.structs.fields(NodeLinks)}
    assert {rule.field for rule in rules.values()} <= fields
    for second in range(8):
        core.on_value(rules["link/loss"], 0.5, second * SECOND)
        core.on_value(rules["link/waiting"], 30.0, second * SECOND)
    assert told(core) == [("link/loss", "warn", Phase.CONFIRMED)]
    assert core.state().level == "warn", "a mission may start"
    for second in range(8, 16):
        core.on_value(rules["link/loss"], 0.1, second * SECOND)
    assert [phase for *_, phase in told(core)] == [Phase.HEALED]
