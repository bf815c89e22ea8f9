"""Precedence of the rates of a channel: the first source that states one decides alone, and is shown."""

from itertools import combinations
from typing import Final

import msgspec
import pytest
from tests.unit.tree.pair import BATTERY, CONFIG, Pair, core, value

from swarmd.tree.config import RuleConfig
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import ChannelLimit, ChannelRate, ChannelSettings, ChannelState, RateSource
from swarmware.types.tree import Rule

LEVEL: Final = Resource(path="power/level", type="Float", owner="hal", link="notify", rate_hz=0.8)
POSE: Final = Resource(path="nav/pose", type="Pose", owner="navigator", rate_hz=10.0)
CAMERA: Final = Resource(path="sensor/scan", kind=Kind.STREAM, type="Blob", owner="hal")
TEMPLATE: Final = (BATTERY, LEVEL, POSE, CAMERA)
DEFAULT_S: Final = 0.5
READ: Final = ("/uav1/power/*", "/uav1/nav/pose", "/uav1/sensor/scan")

SOURCES: Final = (
    ChannelRate(RateSource.OPERATOR, 1.0, "uav1", "**"),
    ChannelRate(RateSource.NOTIFICATION_RULE, 4.0, "uav1", "power/*"),
    ChannelRate(RateSource.FILE, 0.5, "uav1", "power/**"),
    ChannelRate(RateSource.SUBSCRIBER, 0.25, "gcs", "*/*"),
)
"""By precedence; the rates are in no order, so that no slowest or fastest one decides by chance."""
GIVEN: Final = [given for count in range(5) for given in combinations(SOURCES, count)]


def swarm(given: tuple[ChannelRate, ...]) -> Pair:
    """gcs reads boards of uav1, for which the given sources state rates."""
    by_source = {rate.source: rate for rate in given}
    rules: tuple[RuleConfig, ...] = ()
    if wanted := by_source.get(RateSource.SUBSCRIBER):
        rules = (RuleConfig(pattern=wanted.pattern, min_interval_s=4.0),)
    config = msgspec.structs.replace(CONFIG, min_interval_s=DEFAULT_S)
    uav = core("uav1", TEMPLATE, templates=(TEMPLATE,), config=config)
    both = Pair(core("gcs", TEMPLATE, templates=(TEMPLATE,), rules=rules), uav)
    both.trees["gcs"].on_applications([], READ, 0)
    both.meet()
    both.carry()
    limits = [
        ChannelLimit(rate.pattern, ChannelSettings(rate.max_hz), from_file=source is RateSource.FILE)
        for source in (RateSource.OPERATOR, RateSource.FILE)
        if (rate := by_source.get(source))
    ]
    uav.on_limits(tuple(limits), both.now_ns)
    if rule := by_source.get(RateSource.NOTIFICATION_RULE):
        uav.on_rules((Rule(rule.pattern, min_interval_s=0.25),), both.now_ns)
    both.wait(1)
    return both


def shown(both: Pair, path: str) -> ChannelState:
    states = both.trees["uav1"].subscribers.channels(both.now_ns, every=True)
    [found] = [one for one in states if isinstance(one, ChannelState) and one.path == path]
    return found


def arrivals(both: Pair, path: str, seconds: int) -> int:
    """Values of a path that arrive at gcs while its owner writes 20 a second."""
    both.received["gcs"].clear()
    for step in range(20 * seconds):
        both.trees["uav1"].on_values([value(path, float(step), step + 1)], both.now_ns)
        both.wait(0.05)
    return sum(item.path == path for item in both.received["gcs"])


def ids(given: tuple[ChannelRate, ...]) -> str:
    return " + ".join(str(rate.source) for rate in given) or "nothing"


@pytest.mark.parametrize("given", GIVEN, ids=ids)
def test_first_source_by_precedence_decides_rate_of_board(given: tuple[ChannelRate, ...]) -> None:
    both = swarm(given)
    expected = given[0] if given else ChannelRate(RateSource.DEFAULT, 1 / DEFAULT_S, "uav1")
    assert shown(both, "power/battery").rate == expected
    assert expected.max_hz is not None
    assert arrivals(both, "power/battery", 20) == pytest.approx(20 * expected.max_hz, abs=1)


@pytest.mark.parametrize("given", GIVEN, ids=ids)
def test_subscriber_judges_age_by_deciding_rate(given: tuple[ChannelRate, ...]) -> None:
    both = swarm(given)
    replica = both.trees["gcs"].replicas.get("uav1")
    assert replica is not None
    expected_hz = given[0].max_hz if given else None
    assert replica.interval_s("power/battery") == (1 / expected_hz if expected_hz else 0.0)


def test_rate_of_resource_decides_without_rules() -> None:
    both = swarm(())
    assert shown(both, "power/level").rate == ChannelRate(RateSource.RESOURCE, 1.6, "uav1")
    assert arrivals(both, "power/level", 20) == pytest.approx(32, abs=1), "twice its rate at most"
    assert shown(both, "nav/pose").rate == ChannelRate(RateSource.RESOURCE, 10.0, "uav1")
    assert shown(both, "sensor/scan").rate == ChannelRate(platform="uav1")


def test_notification_rule_without_interval_leaves_rate_to_resource() -> None:
    both = swarm((SOURCES[3],))
    both.trees["uav1"].on_rules((Rule("**", deadband=0.1),), both.now_ns)
    assert shown(both, "power/level").rate.source is RateSource.RESOURCE


def test_no_limit_of_operator_precedes_slower_rules() -> None:
    both = swarm(SOURCES)
    both.trees["uav1"].on_limits((ChannelLimit("**", ChannelSettings(1e6)),), both.now_ns)
    assert shown(both, "power/battery").rate == ChannelRate(RateSource.OPERATOR, None, "uav1", "**")
    assert arrivals(both, "power/battery", 2) == 40


def test_board_in_beacons_is_one_channel() -> None:
    both = swarm(())
    other = core(
        "uav2", TEMPLATE, templates=(TEMPLATE,), rules=(RuleConfig(pattern="nav/*", min_interval_s=4.0),)
    )
    uav = both.trees["uav1"]
    both.trees["uav2"], both.received["uav2"] = other, []
    other.on_applications([], ["/uav1/nav/pose"], 0)
    other.on_up("uav1", uav.local.version, True, 0)
    uav.on_up("uav2", other.local.version, True, 0)
    both.carry()
    state = shown(both, "nav/pose")
    assert (state.link, state.rate.max_hz) == ("*", 10.0), "the shortest interval"
    [offer] = uav.subscribers.offers()
    assert not offer.is_ruled
    uav.on_rules((Rule("nav/*", min_interval_s=2.0),), both.now_ns)
    assert shown(both, "nav/pose").rate.source is RateSource.NOTIFICATION_RULE
    [offer] = uav.subscribers.offers()
    assert (offer.min_interval_ms, offer.is_ruled) == (2000, True)


def test_wanted_interval_of_beacon_names_its_subscriber() -> None:
    both = swarm((SOURCES[3],))
    assert shown(both, "nav/pose").rate == SOURCES[3]


def test_request_without_all_omits_channels_without_rules() -> None:
    both = swarm(())
    assert both.trees["uav1"].subscribers.channels(both.now_ns) == ()
