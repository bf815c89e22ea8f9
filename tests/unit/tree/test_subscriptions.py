"""Subscriptions between two trees: values, leases, losses, restarts; what goes into the beacon."""

import msgspec
import pytest
from tests.unit.tree.pair import BATTERY, FAULTS, POSE, STEP, Pair, S, core, pair, value

from swarmd.tree.config import RuleConfig
from swarmd.tree.core.action import SendNotify, Unwatch, Watch
from swarmd.tree.core.replicas.replica import Replica
from swarmd.tree.core.subscribers.subscriber import BYTES_LIMIT, ITEMS_LIMIT
from swarmware.errors import InvalidInput
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import ChannelLimit, ChannelSettings
from swarmware.types.net import BoardPublication, BoardSubscription
from swarmware.types.tree_exchange import BoardLimit, SubscribeReply, SubscribeRequest, TreeItem, TreeNotify


def battery(both: Pair, number: float, sequence: int = 1) -> None:
    both.trees["uav1"].on_values([value("power/battery", number, sequence)], both.now_ns)


def got(both: Pair) -> list[float]:
    return [msgspec.msgpack.decode(item.data)[0] for item in both.received["gcs"]]


def test_owner_watches_and_sends_wanted_resource() -> None:
    both = pair("/uav1/power/battery")
    assert ("uav1", Watch(BATTERY)) in both.log
    battery(both, 0.9)
    both.carry()
    assert got(both) == [0.9]


def test_unwanted_resource_is_no_longer_watched() -> None:
    both = pair("/uav1/power/battery")
    both.trees["gcs"].on_applications([], [], 0)
    both.carry()
    assert both.log[-1] == ("uav1", Unwatch("power/battery"))


def test_far_platform_learns_that_nothing_is_wanted() -> None:
    both = pair("/uav1/power/battery", near=False)
    both.trees["gcs"].on_applications([], [], 0)
    both.carry()
    assert both.trees["uav1"].subscribers.feeds == 0


def test_a_pattern_may_match_nothing_yet() -> None:
    both = pair("/*/plan/*")
    both.trees["uav1"].on_applications([STEP], [], 0)
    both.trees["uav1"].on_values([value("plan/step", 1.0)], 0)
    both.carry()
    assert [item.path for item in both.received["gcs"]] == ["plan/step"]
    replica = both.trees["gcs"].replicas.get("uav1")
    assert replica is not None
    assert replica.index is not None
    assert "plan/step" in replica.index, "the structure came before the value"


def test_who_subscribes_later_gets_the_value_there_is() -> None:
    both = pair("/uav1/power/battery")
    battery(both, 0.9)
    both.carry()
    late = core("uav2")
    late.on_applications([], ["/uav1/power/battery"], 0)
    three = Pair(late, both.trees["uav1"])
    three.meet()
    three.carry()
    assert [item.path for item in three.received["uav2"]] == ["power/battery"]


def test_one_board_value_at_once_newest_next() -> None:
    both = pair("/uav1/power/battery")
    uav = both.trees["uav1"]
    battery(both, 0.9)
    (first,) = uav.drain()
    assert isinstance(first, SendNotify)
    battery(both, 0.8, 2)
    battery(both, 0.7, 3)
    assert uav.drain() == []
    uav.on_notified("gcs", first.notify, True, 1)
    (second,) = uav.drain()
    assert isinstance(second, SendNotify)
    assert [item.sequence for item in second.notify.items] == [3]


def test_unacknowledged_value_is_resent_after_pause() -> None:
    both = pair("/uav1/power/battery")
    battery(both, 0.9)
    both.carry(lose=True)
    assert got(both) == []
    both.wait(0.9)
    assert got(both) == []
    both.wait(0.2)
    assert got(both) == [0.9]
    assert both.trees["uav1"].subscribers.failures == 1


def test_abandoned_value_delays_nothing_behind_it() -> None:
    both = pair("/uav1/power/battery", "/uav1/health/faults")
    uav = both.trees["uav1"]
    uav.on_values([value("health/faults", 1.0, 1, FrameKind.EVENT)], both.now_ns)
    (first,) = uav.drain()
    both.now_ns += S
    battery(both, 0.9)
    (second,) = uav.drain()
    assert isinstance(first, SendNotify)
    assert isinstance(second, SendNotify)
    uav.on_notified("gcs", second.notify, False, both.now_ns)
    both.now_ns += S
    uav.on_notified("gcs", first.notify, False, both.now_ns)
    both.wait(10)
    assert sorted(got(both)) == [0.9, 1.0]


def test_late_notification_does_not_undo_newer_one() -> None:
    both = pair("/uav1/power/battery")
    battery(both, 0.9)
    (old,) = both.trees["uav1"].drain()
    assert isinstance(old, SendNotify)
    both.trees["uav1"].on_notified("gcs", old.notify, False, 0)
    battery(both, 0.8, 2)
    both.wait(2.0)
    both.hear("gcs", old.notify)
    assert got(both) == [0.8]


def test_notification_of_former_start_is_refused() -> None:
    both = pair("/uav1/power/battery")
    battery(both, 0.9)
    (old,) = both.trees["uav1"].drain()
    assert isinstance(old, SendNotify)
    both.replace(core("uav1", epoch=2))
    both.meet()
    both.carry()
    battery(both, 0.5)
    both.carry()
    both.hear("gcs", old.notify)
    battery(both, 0.4, 2)
    both.carry()
    assert got(both) == [0.5, 0.4]


def test_notification_of_unknown_start_counts_and_asks() -> None:
    both = pair("/uav1/power/battery")
    both.replace(core("uav1", epoch=2))
    both.hear("gcs", TreeNotify("uav1", 2, 1, (value("power/battery", 0.3),)))
    assert got(both) == [0.3]
    both.carry()
    replica = both.trees["gcs"].replicas.get("uav1")
    assert replica is not None
    assert replica.epoch == 2


def test_values_that_nobody_asked_for_are_not_taken() -> None:
    both = pair("/uav1/power/battery")
    both.hear("gcs", TreeNotify("uav1", 1, 99, (value("nav/goal", 1.0),)))
    both.hear("gcs", TreeNotify("uav7", 1, 1, (value("power/battery", 1.0),)))
    assert got(both) == []


def test_restarted_subscriber_gets_everything_again() -> None:
    both = pair("/uav1/power/battery")
    battery(both, 0.9)
    both.carry()
    fresh = core("gcs", epoch=5)
    fresh.on_applications([], ["/uav1/power/battery"], 0)
    both.replace(fresh)
    both.meet()
    both.carry()
    assert got(both) == [0.9, 0.9]


def test_lease_survives_silence_of_reachable_subscriber() -> None:
    both = pair("/uav1/power/battery")
    both.log.clear()
    both.wait(3000)
    assert both.log == []
    battery(both, 0.9)
    both.carry()
    assert got(both) == [0.9]


def test_renewal_of_ended_lease_requests_everything() -> None:
    both = pair("/uav1/power/battery")
    uav, gcs = both.trees["uav1"], both.trees["gcs"]
    gcs.on_gone("uav1", 0)
    uav.on_gone("gcs", 0)
    both.wait(70)
    assert uav.subscribers.platforms() == []
    both.meet()
    both.carry()
    battery(both, 0.9)
    both.carry()
    assert got(both) == [0.9]


def test_subscriber_away_for_owner_learns_lease_end() -> None:
    both = pair("/uav1/power/battery")
    uav = both.trees["uav1"]
    uav.on_gone("gcs", both.now_ns)
    both.wait(61)
    assert uav.subscribers.platforms() == []
    uav.on_up("gcs", 1, True, both.now_ns)
    both.carry(lose=True)
    assert uav.subscribers.platforms() == []
    both.wait(3)
    assert uav.subscribers.platforms() == ["gcs"]
    battery(both, 0.9)
    both.carry()
    assert got(both) == [0.9]


def test_subscriber_again_gets_only_later_values() -> None:
    both = pair("/uav1/power/battery")
    for volt in (0.9, 0.8, 0.7):
        battery(both, volt)
        both.carry()
    both.trees["gcs"].on_applications([], [], both.now_ns)
    both.carry()
    assert both.trees["uav1"].subscribers.platforms() == []
    both.trees["gcs"].on_applications([], ["/uav1/power/battery"], both.now_ns)
    both.carry()
    for volt in (0.6, 0.5):
        battery(both, volt)
        both.carry()
    assert got(both) == [0.9, 0.8, 0.7, 0.6, 0.5]


def test_values_after_ended_lease_are_accepted() -> None:
    both = pair("/uav1/power/battery")
    uav, gcs = both.trees["uav1"], both.trees["gcs"]
    for volt in (0.9, 0.8, 0.7):
        battery(both, volt)
        both.carry()
    gcs.on_gone("uav1", both.now_ns)
    uav.on_gone("gcs", both.now_ns)
    both.wait(70)
    assert uav.subscribers.platforms() == []
    both.meet()
    both.carry()
    battery(both, 0.6)
    both.carry()
    assert got(both) == [0.9, 0.8, 0.7, 0.6]


def test_unwanted_subscription_of_former_start_is_cancelled() -> None:
    both = pair("/uav1/power/battery")
    both.replace(core("gcs", epoch=5))
    both.meet()
    both.carry()
    assert both.trees["uav1"].subscribers.platforms() == ["gcs"]
    battery(both, 0.9)
    both.carry()
    assert got(both) == []
    assert both.trees["uav1"].subscribers.platforms() == []


def test_lease_ends_without_delivery_or_announcement() -> None:
    both = pair("/uav1/power/battery")
    uav = both.trees["uav1"]
    battery(both, 0.9)
    for _ in range(100):
        both.carry(lose=True)
        both.now_ns += 2 * S
        uav.on_timer(both.now_ns)
    assert uav.subscribers.platforms() == []


def test_events_during_absence_are_sent_at_return() -> None:
    both = pair("/uav1/power/battery", "/uav1/health/faults")
    uav = both.trees["uav1"]
    uav.on_gone("gcs", 0)
    for sequence in range(1, 4):
        battery(both, sequence / 10, sequence)
        uav.on_values([value("health/faults", sequence, sequence, FrameKind.EVENT)], 0)
    assert both.carry() == 0
    both.meet()
    both.carry()
    assert sorted(got(both)) == [0.3, 1, 2, 3]


def test_rules_of_the_subscriber_hold_at_the_owner() -> None:
    both = Pair(
        core("gcs", rules=(RuleConfig(pattern="power/*", deadband=0.5, min_interval_s=2.0),)), core("uav1")
    )
    both.trees["gcs"].on_applications([], ["/uav1/power/battery"], 0)
    both.meet()
    both.carry()
    for sequence, number in enumerate((1.0, 1.2, 2.0, 2.1), 1):
        battery(both, number, sequence)
        both.carry()
    assert got(both) == [1.0]
    both.wait(2.0)
    assert got(both) == [1.0, 2.1]


def test_periodic_boards_are_for_the_beacon() -> None:
    both = pair("/*/nav/pose")
    gcs, uav = both.trees["gcs"], both.trees["uav1"]
    assert gcs.plan_changed()
    assert uav.plan_changed()
    assert not uav.plan_changed()
    assert uav.subscribers.offers() == [BoardPublication("nav/pose", POSE.data_id, "Pose", 50)]
    assert gcs.replicas.wants() == [BoardSubscription("uav1", "nav/pose", "Pose", POSE.data_id)]
    assert uav.subscribers.feeds == 0
    gcs.on_applications([], [], 0)
    both.carry()
    assert gcs.plan_changed()
    assert uav.plan_changed()
    assert (uav.subscribers.offers(), gcs.replicas.wants()) == ([], [])


def test_shortest_interval_of_subscribers_sets_beacon_rate() -> None:
    uav = core("uav1")
    for name, interval_s in (("gcs", 1.0), ("uav2", 0.2)):
        other = core(name, rules=(RuleConfig(pattern="nav/*", min_interval_s=interval_s),))
        other.on_applications([], ["/uav1/nav/pose"], 0)
        both = Pair(other, uav)
        both.meet()
        both.carry()
    assert [offer.min_interval_ms for offer in uav.subscribers.offers()] == [200]


def test_notification_has_limit_and_rest_follows() -> None:
    both = pair("/uav1/health/faults", "/uav1/power/battery")
    both.log.clear()
    uav = both.trees["uav1"]
    for sequence in range(1, 201):
        uav.on_values(
            [TreeItem("health/faults", 7, FrameKind.EVENT, sequence, sequence, b"x" * 1000)], both.now_ns
        )
    battery(both, 0.9)
    both.carry()
    sent = [action.notify for who, action in both.log if who == "uav1" and isinstance(action, SendNotify)]
    assert all(len(note.items) <= ITEMS_LIMIT for note in sent)
    assert all(sum(len(item.data) for item in note.items) <= BYTES_LIMIT + 32_000 for note in sent)
    events = [item.sequence for item in both.received["gcs"] if item.path == "health/faults"]
    assert events == list(range(1, 201))
    assert "power/battery" in {item.path for note in sent[:3] for item in note.items}, "boards do not starve"


def test_resource_of_changed_type_is_watched_again() -> None:
    both = pair("/uav1/plan/step")
    uav = both.trees["uav1"]
    uav.on_applications([STEP], [], 0)
    both.carry()
    uav.on_values([value("plan/step", 1.0)], 0)
    both.carry()
    other = Resource(path="plan/step", kind=Kind.EVENT, type="Int", owner="planner")
    uav.on_applications([other], [], 0)
    both.carry()
    assert both.log[-1] == ("uav1", Watch(other))


def test_a_pattern_that_is_none_is_refused() -> None:
    request = SubscribeRequest("gcs", 1, 5, 60.0, 0, False, ("nav/{pose",))
    with pytest.raises(InvalidInput):
        core("uav1").on_subscribe_asked(request, None, 0)
    assert FAULTS.link == "notify"


def test_operators_limit_holds_and_events_wait() -> None:
    both = pair("/uav1/power/battery", "/uav1/health/faults")
    uav = both.trees["uav1"]
    uav.on_limits(
        (ChannelLimit("power/*", ChannelSettings(0.5)), ChannelLimit("**", ChannelSettings(5.0))), both.now_ns
    )
    for sequence in range(1, 41):
        battery(both, float(sequence), sequence)
        uav.on_values([value("health/faults", 0.0, sequence, FrameKind.EVENT)], both.now_ns)
        both.wait(0.1)
    taken = [item for item in both.received["gcs"] if item.path == "power/battery"]
    assert [item.sequence for item in taken] == [1, 20, 40], "the newest every two seconds"
    assert len(both.received["gcs"]) - len(taken) == 21, "events at five a second"
    both.wait(10)
    events = [item.sequence for item in both.received["gcs"] if item.kind == FrameKind.EVENT]
    assert events == list(range(1, 41)), "none is left out"
    uav.on_limits((ChannelLimit("**", ChannelSettings(0.0)),), both.now_ns)
    battery(both, 99.0, 99)
    both.wait(100)
    assert both.received["gcs"][-1].sequence != 99
    uav.on_limits((), both.now_ns)
    both.carry()
    assert both.received["gcs"][-1].sequence == 99


def limits_known(both: Pair) -> tuple[BoardLimit, ...]:
    replica = both.trees["gcs"].replicas.get("uav1")
    assert isinstance(replica, Replica)
    return replica.limits


def interval_s(both: Pair, path: str) -> float:
    replica = both.trees["gcs"].replicas.get("uav1")
    assert isinstance(replica, Replica)
    return replica.interval_s(path)


def test_subscriber_knows_limits_from_first_reply() -> None:
    both = Pair(core("gcs"), core("uav1"))
    limits = (
        ChannelLimit("plan/*", ChannelSettings(1.0)),
        ChannelLimit("nav/*", ChannelSettings(0.5), 60.0),
        ChannelLimit("**", ChannelSettings(4.0)),
    )
    both.trees["uav1"].on_limits(limits, 0)
    both.trees["gcs"].on_applications([], ["/uav1/nav/pose", "/uav1/health/faults"], 0)
    both.meet()
    both.carry()
    assert limits_known(both) == (BoardLimit("nav/*", 0.5), BoardLimit("**", 4.0)), "those that concern it"
    assert interval_s(both, "nav/pose") == 2.0
    assert both.said(SendNotify) == 0


def test_later_limit_is_notified_once_despite_loss() -> None:
    both = pair("/uav1/nav/pose", "/uav1/power/battery")
    uav = both.trees["uav1"]
    both.log.clear()
    uav.on_limits((ChannelLimit("nav/*", ChannelSettings(0.5)),), both.now_ns)
    assert both.carry() == 0, "it waits a moment for others to go with it"
    both.now_ns += S
    uav.on_timer(both.now_ns)
    both.carry(lose=True)
    assert interval_s(both, "nav/pose") == 0.0
    both.wait(3)
    assert (interval_s(both, "nav/pose"), interval_s(both, "power/battery")) == (2.0, 0.0)
    both.log.clear()
    uav.on_limits((ChannelLimit("nav/*", ChannelSettings(0.5), 7.0),), both.now_ns)
    both.wait(3)
    assert both.log == [], "how long it lasts is nothing that the subscriber needs"
    uav.on_limits((), both.now_ns)
    both.wait(1)
    assert limits_known(both) == ()


def test_irrelevant_limit_costs_subscriber_nothing() -> None:
    both = pair("/uav1/nav/pose", "/uav1/health/faults")
    both.log.clear()
    both.trees["uav1"].on_limits(
        (ChannelLimit("power/*", ChannelSettings(0.5)), ChannelLimit("health/*", ChannelSettings(0.1))),
        both.now_ns,
    )
    both.wait(10)
    assert both.log == []


def test_limit_travels_with_simultaneous_values() -> None:
    both = pair("/uav1/power/battery")
    both.log.clear()
    both.trees["uav1"].on_limits((ChannelLimit("power/*", ChannelSettings(0.5)),), both.now_ns)
    battery(both, 0.9)
    both.carry()
    both.wait(1)
    assert both.said(SendNotify) == 2
    assert interval_s(both, "power/battery") == 2.0


def test_restarted_platform_without_limits_has_none() -> None:
    both = pair("/uav1/nav/pose")
    both.trees["uav1"].on_limits((ChannelLimit("**", ChannelSettings(0.5)),), both.now_ns)
    both.wait(1)
    assert limits_known(both) == (BoardLimit("**", 0.5),)
    both.replace(core("uav1", epoch=2))
    both.meet()
    both.carry()
    assert limits_known(both) == ()


def test_forbidding_limit_makes_no_age_good() -> None:
    rules = (RuleConfig(pattern="nav/*", min_interval_s=5.0),)
    both = Pair(core("gcs", rules=rules), core("uav1"))
    both.trees["gcs"].on_applications([], ["/uav1/nav/pose"], 0)
    both.meet()
    both.carry()
    assert interval_s(both, "nav/pose") == 5.0
    for max_hz, expected in ((0.0, 5.0), (10.0, 0.1), (0.1, 10.0)):
        both.trees["uav1"].on_limits((ChannelLimit("**", ChannelSettings(max_hz)),), both.now_ns)
        both.wait(1)
        assert interval_s(both, "nav/pose") == expected


def test_invalid_limit_pattern_is_refused_alone() -> None:
    both = pair("/uav1/power/battery")
    garbage = (BoardLimit("nav/{", 1.0),)
    item = value("power/battery", 0.5)
    both.hear("gcs", TreeNotify("uav1", 1, 1, (item,), limits=garbage))
    assert got(both) == [0.5]
    gcs = both.trees["gcs"]
    gcs.on_applications([], ["/uav1/nav/pose"], 0)
    gcs.drain()
    replica = gcs.replicas.get("uav1")
    assert replica is not None
    asked = replica.subscription.wanted.digest
    gcs.on_subscribed("uav1", SubscribeReply(1, replica.digest, limits=garbage), asked, 0)
    assert limits_known(both) == ()
    assert replica.subscription.is_held
