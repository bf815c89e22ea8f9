"""Structures from beacons: when a tree waits for one, when it takes it, and when it asks after all."""

import logging

import msgspec
import pytest
from tests.unit.tree.pair import BATTERY, CONFIG, POSE, STEP, TEMPLATE, S, Tree, core

from swarmd.tree.core.action import PruneMirrors, RequestStructure, RequestSubscription, SendNotify
from swarmd.tree.core.replicas.received_broadcasts import ReceivedBroadcasts
from swarmd.tree.core.replicas.replica import PATIENCE, Replica
from swarmd.tree.core.structure.subscription import LocalSubscriptions
from swarmd.tree.core.tree import BROADCAST_LIMIT
from swarmware.model.names import Address
from swarmware.model.resource import Resource
from swarmware.types.net import StructureBroadcast

WAIT_NS = round(CONFIG.broadcast_s * S)


def broadcast(tree: Tree) -> StructureBroadcast:
    found = tree.broadcast()
    assert isinstance(found, StructureBroadcast)
    return found


def meet(one: Tree, other: Tree, now_ns: int = 0, *, near: bool = True, multicast: bool = True) -> None:
    one.on_multicast(frozenset({str(other.address)} if multicast else ()), now_ns)
    one.on_up(str(other.address), other.local.version, near, now_ns)


def requests(tree: Tree) -> int:
    return sum(isinstance(action, RequestStructure) for action in tree.drain())


def knows(one: Tree, other: Tree) -> bool:
    replica = one.replicas.get(str(other.address))
    assert replica is not None
    return bool(
        replica.structure.is_current
        and replica.digest == other.local.digest
        and replica.epoch == other.local.epoch
    )


def two() -> tuple[Tree, Tree]:
    gcs, uav = core("gcs"), core("uav1", epoch=9)
    uav.on_applications([BATTERY, POSE, STEP], (), 0)
    return gcs, uav


def test_structure_in_beacon_needs_no_request() -> None:
    gcs, uav = two()
    meet(gcs, uav)
    assert gcs.replicas.needs() == ["uav1"]
    assert gcs.plan_changed()
    gcs.on_broadcast(broadcast(uav), 10)
    assert knows(gcs, uav)
    assert gcs.replicas.needs() == []
    assert gcs.plan_changed()
    gcs.on_timer(9 * S)
    assert requests(gcs) == 0


def test_subscription_follows_structure_in_beacon_at_once() -> None:
    gcs, uav = two()
    gcs.on_applications([], ("/*/power/battery",), 0)
    meet(gcs, uav)
    assert gcs.drain() == []
    gcs.on_broadcast(broadcast(uav), 10)
    assert RequestSubscription in [type(action) for action in gcs.drain()]


def test_structure_missing_in_beacons_is_requested() -> None:
    gcs, uav = two()
    meet(gcs, uav)
    assert gcs.deadline_ns() == WAIT_NS
    gcs.on_timer(WAIT_NS)
    action = gcs.drain()[0]
    assert isinstance(action, RequestStructure)
    assert gcs.replicas.needs() == []
    gcs.on_structure("uav1", uav.on_structure_asked(action.request, WAIT_NS), WAIT_NS)
    assert knows(gcs, uav)
    uav.on_applications([BATTERY, POSE], (), 3 * S)
    uav.on_timer(9 * S)
    meet(gcs, uav, 9 * S)
    assert requests(gcs) == 1, "a former version, or a structure that is too large"


def test_late_node_waits_longer_for_beacon() -> None:
    gcs, uav = two()
    meet(gcs, core("uav2", epoch=3))
    gcs.on_timer(WAIT_NS + S)
    gcs.drain()
    now_ns = WAIT_NS + S
    assert gcs.patience_s(now_ns) == PATIENCE
    meet(gcs, uav, now_ns)
    gcs.on_timer(now_ns + WAIT_NS)
    assert requests(gcs) == 0
    gcs.on_timer(now_ns + WAIT_NS + PATIENCE * S)
    assert requests(gcs) == 1
    assert gcs.patience_s(now_ns + 60 * S) == 0


def test_node_is_awaited_again_after_structure_beacon() -> None:
    gcs, uav = two()
    meet(gcs, uav)
    gcs.on_timer(WAIT_NS)
    assert requests(gcs) == 1
    gcs.on_structure("uav1", None, WAIT_NS)
    gcs.on_broadcast(broadcast(uav), WAIT_NS)
    assert knows(gcs, uav), "it came late, but the request failed"
    uav.on_applications([BATTERY], (), 3 * S)
    uav.on_timer(5 * S)
    meet(gcs, uav, 5 * S)
    assert gcs.replicas.needs() == ["uav1"]
    assert requests(gcs) == 0


def test_early_beacon_is_kept_until_version_known() -> None:
    gcs, uav = two()
    gcs.on_broadcast(broadcast(uav), 0)
    meet(gcs, uav)
    assert knows(gcs, uav)
    uav.on_applications([BATTERY, POSE, STEP, Resource(path="a/b", type="Text", owner="c")], (), S)
    gcs.on_broadcast(broadcast(uav), S)
    assert not knows(gcs, uav)
    meet(gcs, uav, S)
    assert knows(gcs, uav)
    assert requests(gcs) == 0


def test_older_structure_from_beacon_replaces_no_newer_one() -> None:
    gcs, uav = two()
    older = broadcast(uav)
    version = uav.local.version
    gcs.on_up("uav1", version, True, 0)
    action = gcs.drain()[0]
    assert isinstance(action, RequestStructure)
    uav.on_applications([BATTERY], (), S)
    uav.on_timer(3 * S)
    gcs.on_structure("uav1", uav.on_structure_asked(action.request, 3 * S), 3 * S)
    assert knows(gcs, uav)
    gcs.on_broadcast(older, 3 * S)
    assert knows(gcs, uav), "its beacons still advertise the older version"


@pytest.mark.parametrize("shown", [0, 1], ids=["before", "between"])
def test_older_structure_replaces_no_changed_one(shown: int) -> None:
    gcs, uav = two()
    gcs.on_applications([], ("/uav1/**",), 0)
    former = [broadcast(uav)]
    meet(gcs, uav)
    gcs.on_broadcast(former[0], 10)
    for action in gcs.drain():
        if isinstance(action, RequestSubscription):
            reply = uav.on_subscribe_asked(action.request, None, 10)
            gcs.on_subscribed("uav1", reply, action.request.set_digest, 10)
    uav.drain()
    replica = gcs.replicas.get("uav1")
    assert replica is not None
    added = [Resource(path=path, type="Text", owner="c") for path in ("a/b", "a/c")]
    versions = [uav.local.version]
    for turn in (1, 2):
        uav.on_applications([BATTERY, POSE, STEP, *added[:turn]], (), turn * S)
        uav.on_timer((turn + 1) * S)
        for action in uav.drain():
            if isinstance(action, SendNotify):
                gcs.on_notify(action.notify, (turn + 1) * S)
                uav.on_notified("gcs", action.notify, True, (turn + 1) * S)
        former.append(broadcast(uav))
        versions.append(uav.local.version)
        assert replica.digest == uav.local.digest
    for older, version in list(zip(former, versions, strict=True))[: shown + 1]:
        gcs.on_up("uav1", version, True, 3 * S)
        gcs.on_broadcast(older, 3 * S)
    gcs.drain()
    gcs.on_applications([], ("/uav1/**", "/uav1/a/b"), 3 * S)
    assert replica.digest == uav.local.digest, "its beacons still advertise the older version"
    assert not any(isinstance(action, PruneMirrors) for action in gcs.drain()), "the value of a/b came once"
    meet(gcs, uav, 4 * S)
    assert knows(gcs, uav)


@pytest.mark.parametrize(
    ("near", "multicast"), [(True, False), (False, False), (False, True)], ids=["unicast", "far", "rumour"]
)
def test_node_without_multicast_is_requested_at_once(near: bool, multicast: bool) -> None:
    gcs, uav = two()
    gcs.on_applications([], ("/uav1/power/battery",), 0)
    meet(gcs, uav, near=near, multicast=multicast)
    assert requests(gcs) == 1
    assert gcs.replicas.needs() == []


def test_own_units_and_operators_needs_are_requested() -> None:
    main, unit = core("uav1"), core("uav1.fc", epoch=9)
    unit.on_applications([STEP], (), 0)
    meet(main, unit)
    assert requests(main) == 1
    gcs, uav = two()
    meet(gcs, uav)
    gcs.on_demand("uav1", 1)
    assert requests(gcs) == 1
    assert gcs.replicas.needs() == []


def test_zero_wait_requests_every_structure_at_once() -> None:
    gcs = core("gcs", config=msgspec.structs.replace(CONFIG, broadcast_s=0.0))
    meet(gcs, core("uav1", epoch=9))
    assert requests(gcs) == 1


def test_a_structure_on_an_unknown_template_is_requested() -> None:
    gcs = core("gcs")
    ugv = core("ugv1", (BATTERY,), templates=((BATTERY,),), epoch=9)
    ugv.on_applications([BATTERY], (), 0)
    meet(gcs, ugv)
    gcs.on_broadcast(broadcast(ugv), 10)
    assert requests(gcs) == 1


def test_damaged_beacon_changes_cause_request(
    caplog: pytest.LogCaptureFixture,
) -> None:
    gcs, uav = two()
    meet(gcs, uav)
    with caplog.at_level(logging.WARNING):
        gcs.on_broadcast(msgspec.structs.replace(broadcast(uav), data=b"damaged"), 10)
    assert "structure of uav1" in caplog.text
    assert requests(gcs) == 1


def test_wait_ends_when_node_is_lost() -> None:
    gcs, uav = two()
    meet(gcs, uav)
    gcs.on_gone("uav1", 1)
    assert gcs.replicas.needs() == []
    gcs.on_timer(WAIT_NS)
    assert requests(gcs) == 0
    gcs.on_broadcast(broadcast(uav), WAIT_NS)
    gcs.on_timer(700 * S)
    assert gcs.replicas.get("uav1") is None


def test_restarted_tree_is_known_by_its_next_beacon() -> None:
    gcs, uav = two()
    meet(gcs, uav)
    gcs.on_broadcast(broadcast(uav), 10)
    again = core("uav1", epoch=10)
    meet(gcs, again, S)
    gcs.on_broadcast(broadcast(again), S)
    assert knows(gcs, again)
    assert requests(gcs) == 0


def test_empty_or_oversized_structure_skips_beacon() -> None:
    assert core("uav1", ()).broadcast() is None
    uav = core("uav1")
    assert len(broadcast(uav).data) <= BROADCAST_LIMIT
    many = [Resource(path=f"a{number * 7919}/b", type="Text", owner=f"o{number}") for number in range(200)]
    uav.on_applications([*TEMPLATE, *many], (), 0)
    assert uav.broadcast() is None


def test_structures_of_invented_names_take_bounded_memory() -> None:
    kept = ReceivedBroadcasts(3)
    for number in range(9):
        kept.put(StructureBroadcast(f"n{number % 5}", 1, number, 0, b""))
    assert len(kept) == 3
    kept.forget("n3")
    kept.forget("n3")
    assert len(kept) == 2
    nobody = Replica(Address("n2"), LocalSubscriptions(Address("gcs"), [], (), lambda _: False))
    assert kept.take(nobody) is None, "it has advertised no version"
