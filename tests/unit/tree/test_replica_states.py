"""The two state tables of a replica, cell by cell: its structure, and the subscription at its platform."""

from itertools import product

import pytest
from tests.unit.tree.pair import BATTERY, POSE

from swarmd.tree.core.replicas.remote_subscription import (
    RemoteSubscription,
    SubscriptionEvent,
    SubscriptionState,
)
from swarmd.tree.core.replicas.structure_replica import StructureEvent, StructureReplica, StructureState
from swarmd.tree.core.structure.index import Index, leaf
from swarmd.tree.core.structure.structure import version
from swarmd.tree.core.structure.subscription import NO_SUBSCRIPTION, make_subscription

EPOCH = 7
INDEX = Index([leaf(BATTERY)])
OTHER = Index([leaf(BATTERY), leaf(POSE)])
WANTED = make_subscription(frozenset({"power/*"}), ())
ANOTHER = make_subscription(frozenset({"nav/*"}), ())


def structure_in(state: StructureState) -> StructureReplica:
    """A replica that came to this state."""
    ways = {
        StructureState.STALE: "",
        StructureState.ASKING: "asked",
        StructureState.MISMATCHED: "asked mismatch",
        StructureState.ASKING_FULL: "asked mismatch asked",
        StructureState.CURRENT: "asked stored",
        StructureState.UNVERIFIED: "asked stored unseen",
    }
    structure = StructureReplica()
    for event in ways[state].split():
        to_structure(structure, StructureEvent(event))
    return structure


def to_structure(structure: StructureReplica, event: StructureEvent) -> None:
    match event:
        case StructureEvent.ASKED:
            structure.on_asked()
        case StructureEvent.NO_REPLY:
            structure.on_no_reply()
        case StructureEvent.MISMATCH:
            structure.on_mismatch()
        case StructureEvent.STORED:
            structure.on_reply(EPOCH, INDEX)
        case StructureEvent.AGREED:
            structure.on_announced(EPOCH, INDEX.digest)
        case StructureEvent.CONTRADICTED:
            structure.on_announced(EPOCH + 1, None)
        case StructureEvent.UNSEEN:
            structure.on_unseen()


STRUCTURE_CELLS = """
             asked       no_reply    mismatch   stored      agreed      contradicted unseen
stale        asking      stale       stale      current     stale       stale        stale
asking       asking      stale       mismatched current     asking      asking       asking
mismatched   asking_full mismatched  mismatched current     mismatched  mismatched   mismatched
asking_full  asking_full mismatched  stale      current     asking_full asking_full  asking_full
unverified   asking      unverified  unverified current     current     stale        unverified
current      current     current     current    current     current     stale        unverified
"""


def cells(text: str) -> dict[tuple[str, str], str]:
    head, *rows = (line.split() for line in text.strip().splitlines())
    return {(row[0], event): after for row in rows for event, after in zip(head, row[1:], strict=True)}


@pytest.mark.parametrize(("state", "event"), list(product(StructureState, StructureEvent)))
def test_the_state_of_a_structure_follows_its_table(state: StructureState, event: StructureEvent) -> None:
    structure = structure_in(state)
    assert structure.state is state
    to_structure(structure, event)
    assert structure.state == cells(STRUCTURE_CELLS)[state, event]


def subscription_in(state: SubscriptionState) -> RemoteSubscription:
    """A subscription that came to this state."""
    ways = {
        SubscriptionState.NONE: "",
        SubscriptionState.MISSING: "differs asked confirmed differs",
        SubscriptionState.ASKING: "differs asked",
        SubscriptionState.HELD: "differs asked confirmed",
        SubscriptionState.UNVERIFIED: "differs asked confirmed unseen",
    }
    subscription = RemoteSubscription(NO_SUBSCRIPTION)
    for event in ways[state].split():
        to_subscription(subscription, SubscriptionEvent(event))
    return subscription


def to_subscription(subscription: RemoteSubscription, event: SubscriptionEvent) -> None:
    match event:
        case SubscriptionEvent.DIFFERS:
            subscription.set_wanted(ANOTHER if subscription.is_held else WANTED)
        case SubscriptionEvent.MATCHES:
            # what it holds is wanted again
            subscription.set_wanted(WANTED if subscription.is_held else subscription.wanted)
        case SubscriptionEvent.EMPTY:
            subscription.wanted = NO_SUBSCRIPTION
            subscription.on_ended()
        case SubscriptionEvent.ASKED:
            subscription.on_asked()
        case SubscriptionEvent.FAILED:
            subscription.on_failed()
        case SubscriptionEvent.CONFIRMED:
            subscription.on_confirmed(EPOCH, subscription.wanted.digest)
        case SubscriptionEvent.UNSEEN:
            subscription.on_unseen()
        case SubscriptionEvent.VERIFIED:
            subscription.on_verified()


SUBSCRIPTION_CELLS = """
            differs    matches    empty  asked      failed     confirmed  unseen     verified
none        missing    none       none   none       none       none       none       none
missing     missing    unverified none   asking     missing    unverified missing    missing
asking      asking     asking     asking asking     missing    held       asking     asking
unverified  missing    unverified none   asking     unverified unverified unverified held
held        missing    held       none   held       held       held       unverified held
"""


@pytest.mark.parametrize(("state", "event"), list(product(SubscriptionState, SubscriptionEvent)))
def test_the_state_of_a_subscription_follows_its_table(
    state: SubscriptionState, event: SubscriptionEvent
) -> None:
    subscription = subscription_in(state)
    assert subscription.state is state
    to_subscription(subscription, event)
    assert subscription.state == cells(SUBSCRIPTION_CELLS)[state, event]


@pytest.mark.parametrize(
    ("epoch", "digest", "after"),
    [
        (EPOCH, INDEX.digest, StructureState.CURRENT),
        (EPOCH, None, StructureState.CURRENT),
        (EPOCH, OTHER.digest, StructureState.STALE),
        (EPOCH + 1, None, StructureState.STALE),
    ],
)
def test_announcement_during_request_is_compared_with_reply(
    epoch: int, digest: int | None, after: StructureState
) -> None:
    structure = structure_in(StructureState.ASKING)
    structure.on_announced(epoch, digest)
    assert structure.is_asking
    structure.on_reply(EPOCH, INDEX)
    structure.compare()
    assert structure.state is after


def test_version_before_request_is_older_than_reply() -> None:
    structure = StructureReplica()
    structure.on_advertised(5)
    structure.on_asked()
    structure.on_reply(EPOCH, INDEX)
    for advertised, after in (
        (5, StructureState.CURRENT),
        (version(EPOCH, INDEX.digest), StructureState.CURRENT),
        (5, StructureState.STALE),
    ):
        structure.on_advertised(advertised)
        structure.compare()
        assert structure.state is after, "another version came in between: the former one is news again"


def test_agreeing_version_keeps_platforms_own_changes() -> None:
    structure = structure_in(StructureState.CURRENT)
    structure.on_announced(EPOCH + 1, None)
    structure.on_advertised(version(EPOCH, INDEX.digest))
    structure.compare()
    assert structure.is_due


def test_subscription_changed_during_request_is_resent() -> None:
    subscription = subscription_in(SubscriptionState.ASKING)
    subscription.set_wanted(ANOTHER)
    subscription.on_confirmed(EPOCH, WANTED.digest)
    assert subscription.state is SubscriptionState.MISSING
    subscription.set_wanted(WANTED)
    assert subscription.on_asked(), "it holds this one: a renewal is enough"


def test_renewal_that_is_unknown_there_is_sent_whole() -> None:
    subscription = subscription_in(SubscriptionState.UNVERIFIED)
    assert subscription.on_asked()
    subscription.on_unknown()
    assert not subscription.is_held
    assert not subscription.on_asked()


@pytest.mark.parametrize(("epoch", "state"), [(EPOCH, "held"), (EPOCH + 1, "missing")])
def test_a_tree_that_has_restarted_holds_no_subscription(epoch: int, state: str) -> None:
    subscription = subscription_in(SubscriptionState.HELD)
    subscription.on_epoch(epoch)
    assert subscription.state == state


def test_a_subscription_of_a_former_start_is_ended() -> None:
    subscription = RemoteSubscription(NO_SUBSCRIPTION)
    subscription.on_former(EPOCH)
    assert subscription.is_due
    subscription.on_asked()
    subscription.on_confirmed(EPOCH, NO_SUBSCRIPTION.digest)
    assert (subscription.state, subscription.is_held) == (SubscriptionState.NONE, False)
