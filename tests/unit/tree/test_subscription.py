"""What is wanted of whom, and which values that means."""

import pytest

from swarmd.tree.core.structure.index import leaf
from swarmd.tree.core.structure.subscription import LocalSubscriptions, make_subscription, subscribable
from swarmware.model.names import Address
from swarmware.model.resource import Kind, Resource
from swarmware.types.tree import Rule

RULE = Rule("power/**", 0.1)


def interests(*patterns: str) -> LocalSubscriptions:
    found = LocalSubscriptions(Address("gcs"), [RULE])
    found.set_patterns(patterns)
    return found


def test_patterns_are_sorted_by_the_platforms_they_name() -> None:
    found = interests("/*/nav/pose", "/uav1/power/battery", "/ugv*/plan/**", "nav/goal", "/gcs/nav/pose")
    assert found.of(Address("uav1")).patterns == ("nav/pose", "power/battery")
    assert found.of(Address("ugv2")).patterns == ("nav/pose", "plan/**")
    assert found.of(Address("usv1")).patterns == ("nav/pose",)


@pytest.mark.parametrize("pattern", ["/**", "/*/**", "/uav1"])
def test_a_whole_platform_may_be_wanted(pattern: str) -> None:
    assert interests(pattern).of(Address("uav1")).patterns == ("**",)


def test_rules_go_along_only_where_something_is_wanted() -> None:
    found = interests("/uav1/nav/pose")
    assert found.of(Address("uav1")).rules == (RULE,)
    assert found.of(Address("uav2")).rules == ()


def test_equal_subscriptions_are_one_object_by_digest() -> None:
    found = interests("/*/nav/pose")
    assert found.of(Address("uav1")) is found.of(Address("uav2"))
    assert make_subscription(frozenset({"a"}), ()).digest != make_subscription(frozenset({"b"}), ()).digest
    assert (
        make_subscription(frozenset({"a"}), ()).digest != make_subscription(frozenset({"a"}), (RULE,)).digest
    )


def test_it_says_whether_anything_changed() -> None:
    found = LocalSubscriptions(Address("gcs"), [])
    assert found.set_patterns(["/uav1/nav/pose"])
    assert not found.set_patterns(["/uav1/nav/pose", "/uav1/nav/pose"])
    assert found.set_patterns([])


def test_invalid_pattern_is_named_and_rest_counts() -> None:
    found = interests("/uav1/nav/{pose", "/uav1/power/battery")
    assert list(found.refused) == ["/uav1/nav/{pose"]
    assert found.of(Address("uav1")).patterns == ("power/battery",)


@pytest.mark.parametrize(
    ("resource", "patterns", "expected"),
    [
        (Resource(path="a/b", type="Float"), ("a/*",), True),
        (Resource(path="a/b", type="Float"), ("c/*",), False),
        (Resource(path="a/b", type="Float", rate_hz=5.0), ("a/*",), True),
        (Resource(path="a/b", type="Float", link="request"), ("a/*",), False),
        (Resource(path="a/b", type="Float", link="request"), ("a/*", "a/b"), True),
        (Resource(path="a/b", kind=Kind.STREAM, type="Blob"), ("**",), False),
        (Resource(path="a/b", kind=Kind.STREAM, type="Blob"), ("a/b",), True),
        (Resource(path="a/b", kind=Kind.COMMAND, type="Goal"), ("a/b",), False),
        (Resource(path="a/b", kind=Kind.FILE, type="Blob"), ("a/b",), False),
        (Resource(path="a", kind=Kind.BRANCH), ("a",), False),
    ],
)
def test_values_move_by_interest(resource: Resource, patterns: tuple[str, ...], expected: bool) -> None:
    assert subscribable(leaf(resource), patterns) is expected


def test_kept_resource_is_slow_unless_read() -> None:
    found = LocalSubscriptions(Address("gcs"), [RULE], ["nav/pose", "power/battery"])
    slow = Rule("nav/pose", min_interval_s=1.0)
    assert found.of(Address("uav1")).patterns == ("nav/pose", "power/battery")
    assert found.of(Address("uav1")).rules == (RULE, slow, Rule("power/battery", min_interval_s=1.0))
    found.set_patterns(["/uav1/power/*"])
    assert found.of(Address("uav1")).rules == (RULE, slow)
    assert found.of(Address("uav1")).patterns == ("nav/pose", "power/*")
    assert found.of(Address("uav2")).patterns == ("nav/pose", "power/battery")
