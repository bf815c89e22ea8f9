"""Two trees that meet: the four steps, second visits, changes, restarts, templates nobody knew."""

import msgspec
import pytest
from tests.unit.tree.pair import CONFIG, POSE, STEP, TEMPLATE, Pair, S, Tree, core, pair, value

from swarmd.tree.core.action import (
    PruneMirrors,
    RemoveMirrors,
    RequestStructure,
    RequestSubscription,
    SendNotify,
)
from swarmd.tree.core.replicas.replica import SyncState
from swarmd.tree.core.structure import structure
from swarmd.tree.core.structure.structure import StructureEncoding
from swarmd.tree.core.tree import SwarmTree
from swarmware.errors import Conflict
from swarmware.model.resource import Resource
from swarmware.types.tree_exchange import StructureReply


def knows(both: Pair, one: str, other: str) -> bool:
    replica = both.trees[one].replicas.get(other)
    tree = both.trees[other].local
    return replica is not None and (replica.epoch, replica.digest) == (tree.epoch, tree.digest)


def test_neighbours_know_each_other_after_one_exchange_each() -> None:
    both = pair()
    assert knows(both, "gcs", "uav1")
    assert knows(both, "uav1", "gcs")
    assert both.said(RequestStructure) == 2
    assert both.said(RequestSubscription) == 0, "nobody wants anything"


@pytest.mark.parametrize("patterns", [(), ("/uav1/power/battery",)])
def test_second_visit_costs_nothing_when_nothing_has_changed(patterns: tuple[str, ...]) -> None:
    both = pair(*patterns)
    both.log.clear()
    for _ in range(2):
        both.trees["gcs"].on_gone("uav1", both.now_ns)
        both.trees["uav1"].on_gone("gcs", both.now_ns)
        both.wait(20)
        both.meet()
        both.carry()
    assert both.log == []
    both.trees["uav1"].on_values([value("power/battery", 0.5)], both.now_ns)
    both.carry()
    assert len(both.received["gcs"]) == len(patterns)


def test_visit_after_half_lease_checks_subscription() -> None:
    both = pair("/uav1/power/battery")
    both.log.clear()
    both.trees["gcs"].on_gone("uav1", both.now_ns)
    both.wait(31)
    both.meet()
    both.carry()
    renewal = both.last("gcs", RequestSubscription)
    assert isinstance(renewal, RequestSubscription)
    assert renewal.request.renew
    assert len(msgspec.msgpack.encode(renewal.request)) < 60
    assert both.said(RequestStructure) == 0


def test_hello_without_version_says_nothing_so_visitor_asks() -> None:
    both = pair()
    both.log.clear()
    both.trees["gcs"].on_gone("uav1", both.now_ns)
    both.trees["gcs"].on_up("uav1", None, True, both.now_ns)
    both.carry()
    assert both.said(RequestStructure) == 1


def test_changes_during_separation_are_requested() -> None:
    both = pair()
    both.trees["gcs"].on_gone("uav1", 0)
    both.trees["uav1"].on_gone("gcs", 0)
    both.trees["uav1"].on_applications([STEP], [], 0)
    both.carry()
    both.meet()
    both.carry()
    assert knows(both, "gcs", "uav1")
    assert both.said(SendNotify) == 0


def test_a_new_resource_is_pushed_to_whoever_subscribed() -> None:
    both = pair("/uav1/power/battery")
    both.log.clear()
    both.trees["uav1"].on_applications([STEP], [], 0)
    both.carry()
    assert not knows(both, "gcs", "uav1"), "it waits a moment for others to go with it"
    both.wait(0.3)
    assert knows(both, "gcs", "uav1")
    assert (both.said(SendNotify), both.said(RequestStructure)) == (1, 0)


def test_unsubscribed_node_requests_new_resource_after_hello() -> None:
    both = pair()
    both.log.clear()
    both.trees["uav1"].on_applications([STEP], [], 0)
    both.wait(0.3)
    assert both.log == []
    both.meet()
    both.carry()
    assert knows(both, "gcs", "uav1")
    assert both.said(RequestStructure) == 1


def test_many_changes_of_a_moment_are_one_notification() -> None:
    both = pair("/uav1/power/battery")
    both.log.clear()
    for number in range(5):
        step = Resource(path=f"plan/step{number}", type="Text", owner="planner")
        both.trees["uav1"].on_applications([step], [], both.now_ns)
        both.wait(0.01)
    both.wait(0.3)
    assert both.said(SendNotify) == 1
    assert knows(both, "gcs", "uav1")


def test_unfitting_changes_are_requested_again() -> None:
    both = pair("/uav1/power/battery")
    replica = both.trees["gcs"].replicas.get("uav1")
    assert replica is not None
    assert replica.index is not None
    replica.structure.index = damaged = replica.index.copy()
    damaged.remove("nav/pose")  # a fault in memory, if you like
    both.trees["uav1"].on_applications([STEP], [], 0)
    both.wait(0.3)
    assert knows(both, "gcs", "uav1")


def test_unfitting_version_in_hello_causes_request() -> None:
    both = pair()
    both.log.clear()
    uav, gcs = both.trees["uav1"], both.trees["gcs"]
    gcs.on_up("uav1", uav.local.version, True, 0)
    assert both.carry() == 0
    gcs.on_up("uav1", uav.local.version ^ 1, True, 0)
    both.carry()
    assert both.said(RequestStructure) == 1
    gcs.on_up("uav1", uav.local.version ^ 1, True, 0)
    assert both.carry() == 0, "a rumour that was checked already"


def test_structure_returning_to_former_version_is_requested() -> None:
    both = pair()
    uav, gcs = both.trees["uav1"], both.trees["gcs"]
    before = uav.local.version
    gcs.on_up("uav1", before ^ 1, True, 0)
    (asked,) = gcs.drain()
    assert isinstance(asked, RequestStructure)
    gcs.on_up("uav1", before, True, 0)
    uav.on_applications([STEP], [], 0)
    gcs.on_structure("uav1", uav.on_structure_asked(asked.request, 0), 0)
    gcs.on_up("uav1", uav.local.version, True, 0)
    both.carry()
    assert knows(both, "gcs", "uav1")
    gcs.on_up("uav1", before ^ 1, True, 0)
    both.carry()
    uav.on_applications([], [], 0)
    both.wait(20)
    gcs.on_up("uav1", uav.local.version, True, both.now_ns)
    both.carry()
    assert uav.local.version == before
    assert knows(both, "gcs", "uav1")


def test_restarted_tree_is_noticed_by_first_question() -> None:
    both = pair("/uav1/power/battery")
    both.log.clear()
    both.replace(core("uav1", epoch=2))
    both.trees["uav1"].on_up("gcs", both.trees["gcs"].local.version, True, 0)
    both.carry()
    assert knows(both, "gcs", "uav1")
    assert both.trees["uav1"].subscribers.platforms() == ["gcs"]


def test_template_that_was_not_known_is_learnt_once() -> None:
    strange = (POSE, Resource(path="sensor/sonar", type="Range", owner="hal"))
    gcs = core("gcs")
    for name in ("usv1", "usv2"):
        both = Pair(gcs, core(name, strange))
        both.meet()
        both.carry()
        assert knows(both, "gcs", name)
        asked = [action for who, action in both.log if who == "gcs" and isinstance(action, RequestStructure)]
        assert [action.request.full for action in asked] == ([False, True] if name == "usv1" else [False])


def test_request_without_answer_is_repeated_with_pauses() -> None:
    both = Pair(core("gcs"), core("uav1"))
    both.trees["gcs"].on_up("uav1", None, True, 0)
    both.carry(lose=True)
    assert both.trees["gcs"].deadline_ns() == 1 * S
    both.now_ns = 1 * S
    both.trees["gcs"].on_timer(both.now_ns)
    both.carry(lose=True)
    assert both.trees["gcs"].deadline_ns() == 3 * S
    both.wait(2.0)
    assert knows(both, "gcs", "uav1")


def test_nobody_is_asked_who_cannot_be_reached() -> None:
    both = Pair(core("gcs"), core("uav1"))
    gcs = both.trees["gcs"]
    gcs.on_up("uav1", None, True, 0)
    gcs.drain()
    gcs.on_gone("uav1", 0)
    gcs.on_structure("uav1", None, 0)
    assert gcs.drain() == []
    assert gcs.deadline_ns() == 600 * S


def test_lost_platform_with_kept_values_is_remembered() -> None:
    gcs = Tree(SwarmTree("gcs", TEMPLATE, CONFIG, epoch=1, keep=["nav/pose"]))
    both = Pair(gcs, core("uav1"))
    both.meet()
    both.carry()
    assert both.trees["uav1"].subscribers.offers()[0].min_interval_ms == 1000
    assert [(want.platform, want.path) for want in gcs.replicas.wants()] == [("uav1", "nav/pose")]
    gcs.on_gone("uav1", 0)
    gcs.on_timer(10_000 * S)
    replica = gcs.replicas.get("uav1")
    assert replica is not None
    assert replica.index is not None


def test_leaving_resource_is_announced_to_remove_mirrors() -> None:
    both = pair("/uav1/plan/*")
    uav = both.trees["uav1"]
    first = [action for who, action in both.log if who == "gcs" and isinstance(action, PruneMirrors)]
    assert [action.platform for action in first] == ["uav1"], "mirrors of a former start may be there"
    uav.on_applications([STEP], [], 0)
    both.wait(1)
    both.log.clear()
    uav.on_applications([], [], both.now_ns)
    both.wait(20)
    (kept,) = [action for who, action in both.log if who == "gcs" and isinstance(action, PruneMirrors)]
    assert kept.paths == {resource.path for resource in TEMPLATE}


def test_platform_of_orphaned_mirrors_is_forgotten() -> None:
    gcs = core("gcs")
    gcs.on_former_mirrors("uav1", 0)
    gcs.on_former_mirrors("uav2", 0)
    gcs.on_up("uav2", None, True, 1)
    gcs.drain()
    gcs.on_timer(600 * S)
    assert gcs.drain() == [RemoveMirrors("uav1")]


def test_departed_platform_is_forgotten_by_order() -> None:
    both = pair("/uav1/nav/pose")
    gcs = both.trees["gcs"]
    with pytest.raises(Conflict, match="uav1: reachable from gcs"):
        gcs.on_removal("uav1", 0)
    gcs.on_gone("uav1", 0)
    gcs.drain()
    assert gcs.on_removal("uav1", 1)
    assert gcs.drain() == [RemoveMirrors("uav1")]
    assert gcs.replicas.get("uav1") is None
    assert not gcs.on_removal("uav1", 2)
    gcs.on_timer(600 * S)
    assert gcs.drain() == []


def test_a_platform_that_stays_away_is_forgotten() -> None:
    both = pair("/uav1/nav/pose")
    gcs = both.trees["gcs"]
    gcs.on_gone("uav1", 0)
    gcs.on_timer(600 * S)
    assert gcs.drain() == [RemoveMirrors("uav1")]
    assert gcs.replicas.get("uav1") is None
    assert gcs.replicas.wants() == []


@pytest.mark.parametrize(
    "reply",
    [
        StructureReply(1, 99, StructureEncoding.UNCHANGED),
        StructureReply(1, 99, StructureEncoding.CHANGES, 0, structure.encode([], ["nav/pose"])),
        StructureReply(1, 99, StructureEncoding.TEMPLATE, 5, structure.encode([], [])),
        StructureReply(1, 99, StructureEncoding.FULL, 5, structure.encode([], [])),
        StructureReply(1, 99, 77, 5, structure.encode([], [])),
        StructureReply(1, 99, StructureEncoding.CHANGES, 0, b"nonsense"),
    ],
)
def test_inconsistent_answer_is_refused(reply: StructureReply) -> None:
    gcs = core("gcs")
    gcs.on_up("uav1", None, True, 0)
    gcs.drain()
    gcs.on_structure("uav1", reply, 0)
    (again,) = gcs.drain()
    assert isinstance(again, RequestStructure)
    assert again.request.full
    gcs.on_structure("uav1", reply, 0)
    assert gcs.drain() == [], "it has been asked for everything: a pause first"
    assert gcs.deadline_ns() == 1 * S
    replica = gcs.replicas.get("uav1")
    assert replica is not None
    assert replica.index is None


def test_unwanted_far_platforms_are_left_alone() -> None:
    both = pair(near=False)
    assert both.said(RequestStructure) == 0
    both.trees["gcs"].on_applications([], ["/uav1/power/battery"], 0)
    both.carry()
    assert knows(both, "gcs", "uav1")
    assert not knows(both, "uav1", "gcs")


def test_query_of_far_platform_subscribes_to_nothing() -> None:
    both = pair(near=False)
    both.trees["gcs"].on_demand("uav1", 0)
    assert both.trees["gcs"].replicas.asks("uav1")
    both.carry()
    assert knows(both, "gcs", "uav1")
    assert both.said(RequestSubscription) == 0
    both.trees["gcs"].on_demand("uav9", 0)
    assert not both.trees["gcs"].replicas.asks("uav9")


def test_whole_swarm_follows_everybody() -> None:
    everybody = msgspec.structs.replace(CONFIG, whole_swarm=True)
    both = Pair(core("gcs", config=everybody), core("uav1"))
    both.meet(near=False)
    both.carry()
    assert knows(both, "gcs", "uav1")
    assert both.trees["uav1"].subscribers.platforms() == []


def test_approaching_node_is_requested_again() -> None:
    both = pair()
    both.trees["gcs"].on_up("uav1", None, False, 0)
    both.trees["uav1"].on_gone("gcs", 0)
    both.trees["uav1"].on_applications([STEP], [], 0)
    both.carry()
    both.trees["gcs"].on_up("uav1", None, True, 0)
    both.carry()
    assert knows(both, "gcs", "uav1")


def test_structure_of_one_kind_is_hash_on_wire() -> None:
    both = Pair(core("gcs"), core("uav1"))
    both.meet()
    asked = both.trees["gcs"].drain()
    assert isinstance(asked[0], RequestStructure)
    reply = both.trees["uav1"].on_structure_asked(asked[0].request, 0)
    assert len(TEMPLATE) == 3
    assert len(msgspec.msgpack.encode(asked[0].request)) + len(msgspec.msgpack.encode(reply)) < 100


def test_given_structure_excludes_resources_of_others() -> None:
    own = Resource(path="relay/load", type="Float", owner="relay")
    relay = core("uav2", (own,), templates=((own,), TEMPLATE))
    relay.on_applications([], ["/uav1/**"], 0)
    upstream = Pair(core("uav1", templates=((own,), TEMPLATE)), relay)
    upstream.meet()
    upstream.carry()
    upstream.trees["uav1"].on_values([value("power/battery", 0.5)], 0)
    upstream.carry()
    assert upstream.received["uav2"], "it holds a value of the other one"
    downstream = Pair(relay, core("gcs", templates=((own,), TEMPLATE)))
    downstream.meet()
    downstream.carry()
    seen = downstream.trees["gcs"].replicas.get("uav2")
    assert seen is not None
    assert seen.index is not None
    assert [item.resource.path for item in seen.index] == ["relay/load"]


def test_synchronised_followed_trees_are_counted_by_digest() -> None:
    both = Pair(core("gcs"), core("uav1"))
    gcs = both.trees["gcs"]
    assert gcs.replicas.sync() == SyncState(0, 0, 0)
    gcs.on_applications([], ["/uav1/power/battery"], 0)
    both.meet()
    assert gcs.replicas.sync() == SyncState(1, 0, 0), "it is asked"
    assert gcs.replicas.follows("uav1")
    both.carry()
    assert gcs.replicas.sync() == SyncState(1, 1, 1)
    both.trees["uav1"].on_applications([STEP], [], 0)
    gcs.on_up("uav1", both.trees["uav1"].local.version, True, 0)
    assert gcs.replicas.sync() == SyncState(1, 0, 1), "the beacon announces another structure"
    both.carry()
    assert gcs.replicas.sync() == SyncState(1, 1, 1)
    gcs.on_applications([], ["/uav1/**"], 0)
    assert gcs.replicas.sync() == SyncState(1, 1, 0), "it does not hold the new subscription yet"
    both.carry()
    gcs.on_gone("uav1", 0)
    assert gcs.replicas.sync() == SyncState(0, 0, 0), "nobody to agree with"


def test_unread_far_platform_is_not_followed() -> None:
    both = pair(near=False)
    assert both.trees["gcs"].replicas.sync() == SyncState(0, 0, 0)
    assert not both.trees["gcs"].replicas.follows("uav1")
