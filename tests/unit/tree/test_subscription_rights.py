"""Who may subscribe to what: resources beyond the role of a subscriber are left out of its subscription."""

import pytest
from tests.unit.tree.pair import BATTERY, CONFIG, FAULTS, TEMPLATE, S

from swarmd.tree.core.structure.subscription import make_subscription
from swarmd.tree.core.tree import SwarmTree
from swarmware.model.access import Access, AccessRule, Role, Sender, Verb
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import SubscribeReply, SubscribeRequest

RULES = (
    AccessRule(Verb.SUBSCRIBE, "health/**", "operator"),
    AccessRule(Verb.SUBSCRIBE, "nav/**", "node"),
    AccessRule(Verb.SUBSCRIBE, "**", "observer"),
)


def tree() -> SwarmTree:
    return SwarmTree("uav1", TEMPLATE, CONFIG, epoch=1, access=Access(RULES))


def subscribe(owner: SwarmTree, sender: Sender | None, *, renew: bool = False) -> SubscribeReply:
    asked = make_subscription(frozenset({"**"}), ())
    patterns = () if renew else asked.patterns
    request = SubscribeRequest("gcs", 1, asked.digest, 60.0, renew=renew, patterns=patterns)
    return owner.on_subscribe_asked(request, sender, 0)[0]


def sent(owner: SwarmTree) -> set[str]:
    [one] = owner.subscribers._subscribers.values()
    return {*one.feeds, *(resource.path for resource in one.plan.beacon_boards)}


@pytest.mark.parametrize(
    ("sender", "paths"),
    [
        (Sender("gcs", Role.OBSERVER), {BATTERY.path}),
        (Sender("gcs", Role.NODE), {BATTERY.path, "nav/pose"}),
        (Sender("gcs", Role.OPERATOR), {BATTERY.path, "nav/pose", FAULTS.path}),
        (None, {BATTERY.path, "nav/pose", FAULTS.path}),
    ],
    ids=["observer", "node", "operator", "without keys"],
)
def test_a_subscriber_gets_what_its_role_may_have(sender: Sender | None, paths: set[str]) -> None:
    owner = tree()
    subscribe(owner, sender)
    assert sent(owner) == paths


def test_renewal_with_another_role_changes_what_is_sent() -> None:
    owner = tree()
    subscribe(owner, Sender("gcs", Role.OPERATOR))
    assert not subscribe(owner, Sender("gcs", Role.OBSERVER), renew=True).unknown
    assert sent(owner) == {BATTERY.path}
    assert not subscribe(owner, Sender("gcs", Role.OPERATOR), renew=True).unknown
    assert FAULTS.path in sent(owner)


def test_a_change_of_the_structure_keeps_the_rights() -> None:
    owner = tree()
    subscribe(owner, Sender("gcs", Role.OBSERVER))
    owner.on_applications([FAULTS, BATTERY], [], S)
    assert FAULTS.path not in sent(owner)


def test_a_rule_of_notifications_keeps_the_rights() -> None:
    owner = tree()
    subscribe(owner, Sender("gcs", Role.OBSERVER))
    owner.on_rules((Rule("**", min_interval_s=1.0),), S)
    assert sent(owner) == {BATTERY.path}


def test_other_access_rules_change_sent_values() -> None:
    access = Access(RULES)
    owner = SwarmTree("uav1", TEMPLATE, CONFIG, epoch=1, access=access)
    subscribe(owner, Sender("gcs", Role.NODE))
    access.set_rules((AccessRule(Verb.SUBSCRIBE, "nav/**", "operator"), *RULES))
    owner.on_access(S)
    assert sent(owner) == {BATTERY.path}
    access.set_rules(())
    owner.on_access(2 * S)
    assert sent(owner) == set()
