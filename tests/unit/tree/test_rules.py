"""Rules of operators for the notifications of a platform: in force for all subscribers, kept over starts."""

import logging
from pathlib import Path

import msgspec
import pytest
from tests.unit.tree.pair import POSE, Pair, core, pair, value

from swarmd.tree.config import RuleConfig
from swarmd.tree.core.replicas.replica import Replica
from swarmd.tree.settings.rule_store import RuleStore
from swarmware.errors import InvalidInput, NotFound
from swarmware.types.channel import ChannelLimit, ChannelSettings
from swarmware.types.net import BoardPublication
from swarmware.types.tree import Rule, TreeRule


def got(both: Pair) -> list[float]:
    return [msgspec.msgpack.decode(item.data)[0] for item in both.received["gcs"]]


def write(both: Pair, number: float, sequence: int) -> None:
    both.trees["uav1"].on_values([value("power/battery", number, sequence)], both.now_ns)
    both.carry()


def interval_s(both: Pair, path: str) -> float:
    replica = both.trees["gcs"].replicas.get("uav1")
    assert isinstance(replica, Replica)
    return replica.interval_s(path)


def test_operators_rule_replaces_subscribers_at_once() -> None:
    own = RuleConfig(pattern="power/*", deadband=100.0)
    both = Pair(core("gcs", rules=(own,)), core("uav1"))
    both.trees["gcs"].on_applications([], ["/uav1/power/battery"], 0)
    both.meet()
    both.carry()
    for sequence, number in enumerate((1.0, 9.0), 1):
        write(both, number, sequence)
    assert got(both) == [1.0], "the deadband of the subscriber"
    both.trees["uav1"].on_rules((Rule("power/*", 0.5, 2.0),), both.now_ns)
    both.carry()
    for sequence, number in enumerate((9.2, 10.0, 11.0), 3):
        write(both, number, sequence)
    assert got(both) == [1.0, 9.0]
    both.wait(2.0)
    assert got(both) == [1.0, 9.0, 11.0], "one in two seconds, the newest"
    both.trees["uav1"].on_rules((), both.now_ns)
    both.carry()
    write(both, 12.0, 9)
    assert got(both)[-1] != 12.0, "the rule of the subscriber again"


def test_value_is_repeated_after_maximum_interval_of_rule() -> None:
    both = pair("/uav1/power/battery")
    both.trees["uav1"].on_rules((Rule("**", 0.0, 0.0, 5.0),), both.now_ns)
    write(both, 1.0, 1)
    both.wait(12.0)
    assert got(both) == [1.0, 1.0, 1.0]


def test_rule_sets_beacon_interval_known_to_subscribers() -> None:
    both = pair("/*/nav/pose", "/uav1/power/battery")
    uav = both.trees["uav1"]
    assert uav.plan_changed()
    uav.on_rules((Rule("nav/*", 0.0, 0.5), Rule("power/*", 0.0, 4.0)), both.now_ns)
    assert uav.plan_changed()
    assert uav.subscribers.offers() == [BoardPublication("nav/pose", POSE.data_id, "Pose", 500, True)]
    both.wait(1.0)
    assert interval_s(both, "nav/pose") == 0.5
    assert interval_s(both, "power/battery") == 4.0
    # a rule of channels by an operator precedes it, the file of channels does not
    uav.on_limits((ChannelLimit("**", ChannelSettings(1.0)),), both.now_ns)
    both.wait(1.0)
    assert (interval_s(both, "nav/pose"), interval_s(both, "power/battery")) == (1.0, 1.0)
    uav.on_limits((ChannelLimit("**", ChannelSettings(1.0), from_file=True),), both.now_ns)
    both.wait(1.0)
    assert (interval_s(both, "nav/pose"), interval_s(both, "power/battery")) == (0.5, 4.0)


def test_first_rule_that_matches_is_that_of_resource() -> None:
    uav = core("uav1")
    rules = (Rule("power/battery", 1.0), Rule("power/*", 2.0))
    uav.on_rules(rules, 0)
    assert uav.subscribers.rule_of("power/battery") == rules[0]
    assert uav.subscribers.rule_of("power/fuel") == rules[1]
    assert uav.subscribers.rule_of("nav/pose") is None


def test_rules_are_kept_newest_first_and_editable(
    tmp_path: Path,
) -> None:
    path = tmp_path / "data" / "rules.toml"
    store = RuleStore(path)
    for request in (
        TreeRule("power/*", deadband=0.5),
        TreeRule("nav/*", min_interval_s=1.0),
        TreeRule("power/*", max_interval_s=30.0),
    ):
        store.put(store.changed(request))
    kept = RuleStore(path).rules
    assert kept == (Rule("nav/*", 0.0, 1.0), Rule("power/*", 0.5, 0.0, 30.0))
    store.put(store.changed(TreeRule("nav/*", reset=True)))
    assert [rule.pattern for rule in RuleStore(path).rules] == ["power/*"]
    with pytest.raises(NotFound, match=r"rule nav/\*: not set; rules in force: power/\*"):
        store.changed(TreeRule("nav/*", reset=True))


@pytest.mark.parametrize(
    "request_",
    [
        TreeRule("{", deadband=1.0),
        TreeRule("**", deadband=-1.0),
        TreeRule("**", deadband=float("nan")),
        TreeRule("**", min_interval_s=float("inf")),
        TreeRule("**", min_interval_s=-1.0),
        TreeRule("**", min_interval_s=5.0, max_interval_s=2.0),
    ],
)
def test_senseless_rule_is_refused_and_changes_nothing(tmp_path: Path, request_: TreeRule) -> None:
    store = RuleStore(tmp_path / "rules.toml")
    with pytest.raises(InvalidInput):
        store.changed(request_)
    assert store.rules == ()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"rules = 5", b"\xff", b"[[rules]]\npattern = '{'", b"[[rules]]\ncolour = 1"]
)
def test_damaged_rule_file_is_set_aside(
    tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "rules.toml"
    path.write_bytes(content)
    with caplog.at_level(logging.ERROR):
        assert RuleStore(path).rules == ()
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [content]
    assert not path.exists()
    assert str(path) in caplog.text
