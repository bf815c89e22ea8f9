"""Subscription of this platform at one other platform."""

from enum import StrEnum
from typing import Final

from swarmd.tree.core.structure.subscription import NO_SUBSCRIPTION, Subscription

UNKNOWN_BODY: Final = -1
"""Digest of a subscription of an earlier start of this tree."""


class SubscriptionState(StrEnum):
    """Whether the other platform holds the subscription."""

    NONE = "none"
    """There is nothing to subscribe to, and nothing is subscribed."""
    MISSING = "missing"
    """The subscription has to be sent, changed or ended."""
    ASKING = "asking"
    """A request has no reply yet."""
    UNVERIFIED = "unverified"
    """The subscription was held before the platform was lost, and its lease may have ended."""
    HELD = "held"
    """The platform holds exactly this subscription."""


class SubscriptionEvent(StrEnum):
    """Events of a subscription at another platform."""

    DIFFERS = "differs"
    """The platform's copy of the subscription is missing or outdated."""
    MATCHES = "matches"
    """The platform's copy of the subscription is the wanted one, as far as is known."""
    EMPTY = "empty"
    """The platform holds no subscription, and none is wanted."""
    ASKED = "asked"
    FAILED = "failed"
    """There was no reply, or the platform does not hold what was to be renewed."""
    CONFIRMED = "confirmed"
    """The platform replied that it holds what was sent."""
    UNSEEN = "unseen"
    """The platform was lost."""
    VERIFIED = "verified"
    """The platform is back within the lease, with the same tree."""


TRANSITIONS: Final[dict[tuple[SubscriptionState, SubscriptionEvent], SubscriptionState]] = {
    (SubscriptionState.NONE, SubscriptionEvent.DIFFERS): SubscriptionState.MISSING,
    (SubscriptionState.MISSING, SubscriptionEvent.MATCHES): SubscriptionState.UNVERIFIED,
    (SubscriptionState.MISSING, SubscriptionEvent.EMPTY): SubscriptionState.NONE,
    (SubscriptionState.MISSING, SubscriptionEvent.ASKED): SubscriptionState.ASKING,
    (SubscriptionState.ASKING, SubscriptionEvent.FAILED): SubscriptionState.MISSING,
    (SubscriptionState.ASKING, SubscriptionEvent.CONFIRMED): SubscriptionState.HELD,
    (SubscriptionState.UNVERIFIED, SubscriptionEvent.DIFFERS): SubscriptionState.MISSING,
    (SubscriptionState.UNVERIFIED, SubscriptionEvent.EMPTY): SubscriptionState.NONE,
    (SubscriptionState.UNVERIFIED, SubscriptionEvent.ASKED): SubscriptionState.ASKING,
    (SubscriptionState.UNVERIFIED, SubscriptionEvent.VERIFIED): SubscriptionState.HELD,
    (SubscriptionState.HELD, SubscriptionEvent.DIFFERS): SubscriptionState.MISSING,
    (SubscriptionState.HELD, SubscriptionEvent.EMPTY): SubscriptionState.NONE,
    (SubscriptionState.HELD, SubscriptionEvent.UNSEEN): SubscriptionState.UNVERIFIED,
}
"""All transitions; any other event leaves the state unchanged.

What changes during a request is compared after its reply.
"""


class RemoteSubscription:
    """What this platform subscribes to at another one, and what that one is known to hold."""

    __slots__ = ("_held", "state", "wanted")

    def __init__(self, wanted: Subscription) -> None:
        self.state = SubscriptionState.NONE
        self.wanted = wanted
        self._held: tuple[int, int] | None = None
        """Epoch of the other tree and digest of the subscription that it holds."""
        self._compare()

    @property
    def is_held(self) -> bool:
        """Whether the other platform holds a subscription, be it a former one."""
        return self._held is not None

    @property
    def is_due(self) -> bool:
        """Whether a request has to be sent."""
        return self.state in {SubscriptionState.MISSING, SubscriptionState.UNVERIFIED}

    @property
    def is_asking(self) -> bool:
        """Whether a request has no reply yet."""
        return self.state is SubscriptionState.ASKING

    @property
    def is_settled(self) -> bool:
        """Whether the other platform holds exactly what is wanted, or nothing is wanted."""
        return self.state in {SubscriptionState.HELD, SubscriptionState.NONE}

    @property
    def will_report(self) -> bool:
        """Whether a reply will come, which has the digest of the structure, too."""
        return self.is_due or self.is_asking

    def set_wanted(self, wanted: Subscription) -> None:
        """The applications subscribe to something else."""
        self.wanted = wanted
        self._compare()

    def on_asked(self) -> bool:
        """A request is sent; returns True if it only renews the former subscription, without a body."""
        # a renewal carries only the digest, where a body may have many patterns
        renews = self.state is SubscriptionState.UNVERIFIED
        self._on(SubscriptionEvent.ASKED)
        return renews

    def on_failed(self) -> None:
        """There was no reply to the request."""
        self._on(SubscriptionEvent.FAILED)
        self._compare()

    def on_unknown(self) -> None:
        """The platform replied that it holds no subscription: it needs the whole one, or has no room."""
        self._held = None
        self.on_failed()

    def on_confirmed(self, epoch: int, digest: int) -> None:
        """The tree of this epoch holds the subscription with this digest, which was sent."""
        self._held = None if digest == NO_SUBSCRIPTION.digest else (epoch, digest)
        self._on(SubscriptionEvent.CONFIRMED)
        self._compare()

    def on_ended(self) -> None:
        """The other platform holds none."""
        self._held = None
        self._compare()

    def on_former(self, epoch: int) -> None:
        """The platform sends values for a subscription of an earlier start of this tree."""
        # no digest equals this one, so the subscription is replaced or ended
        self._held = (epoch, UNKNOWN_BODY)
        self._compare()

    def on_epoch(self, epoch: int) -> None:
        """The other tree has this epoch; a restarted tree holds no subscription."""
        if self._held is not None and self._held[0] != epoch:
            self.on_ended()

    def on_unseen(self) -> None:
        """The platform was lost."""
        self._on(SubscriptionEvent.UNSEEN)

    def on_verified(self) -> None:
        """The platform is back within the lease, with the same tree."""
        self._on(SubscriptionEvent.VERIFIED)

    def _compare(self) -> None:
        if self._held is not None and self._held[1] == self.wanted.digest:
            self._on(SubscriptionEvent.MATCHES)
        elif self._held is not None or self.wanted.patterns:
            self._on(SubscriptionEvent.DIFFERS)
        else:
            self._on(SubscriptionEvent.EMPTY)

    def _on(self, event: SubscriptionEvent) -> None:
        """The only place that changes the state."""
        self.state = TRANSITIONS.get((self.state, event), self.state)
