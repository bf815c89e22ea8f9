"""The sender's side: pending messages and requests, their retransmissions and time-outs."""

from collections import Counter, defaultdict
from typing import Final

import msgspec

from swarmware.model.frame import Flag, Frame, FrameKind
from swarmware.runtime.timers import Timers
from swarmware.transport.delivery.outcome import FULL, Outcome, Status
from swarmware.transport.retransmission.flight import Flight, Sent
from swarmware.transport.retransmission.policy import RetransmissionPolicy
from swarmware.transport.retransmission.rtt import RttEstimator
from swarmware.types.rpc import Ack

Key = tuple[int, int, int]
"""Application, data id, sequence: the fields of a question that its answer repeats."""

LOCAL: Final = RetransmissionPolicy(initial_ns=50_000_000, min_ns=50_000_000, max_ns=400_000_000)
"""Inside a platform a message is lost only with its receiver, or waits for a full inbox."""
REMOTE: Final = RetransmissionPolicy(initial_ns=300_000_000, min_ns=100_000_000, max_ns=2_400_000_000)
"""Between platforms, over radio links: 0.3, 0.6, 1.2 s until a round trip was measured."""

_STATUSES: Final = {int(status): status for status in Status}
_BULK: Final = int(Flag.BULK)
_COMMANDS: Final = frozenset({FrameKind.MESSAGE, FrameKind.REQUEST})

WINDOW: Final = 256
"""Unanswered messages of one data id to one platform; further ones are refused to the sender at once."""
GRACE_NS: Final = 1_000_000_000
"""Time within which an absent receiver may appear: there is no start order (S0.37)."""


class Transmit(msgspec.Struct, frozen=True):
    """Send this frame, for the first time or again."""

    frame: Frame


class Complete(msgspec.Struct, frozen=True):
    """Report the outcome to the sender."""

    key: Key
    outcome: Outcome


Action = Transmit | Complete


_Way = tuple[int, bool]
"""Receiver's hardware, and whether it is a command, which does not wait behind notifications and streams: the
round trip of each is measured apart."""


class _Pending(Sent):
    frame: Frame
    way: _Way
    expires_ns: int
    wait_ns: int
    policy: RetransmissionPolicy
    absent_since_ns: int | None = None
    reached: bool = False
    """True if it was passed to an application, which has died if it is absent later."""
    soft_refusal: Outcome | None = None
    """Newest temporary refusal: the outcome if no other follows before the time-out."""

    def next_wait_ns(self) -> int:
        """Time to the transmission after this one: it doubles, unless a hop has answered that it has no
        route, which may return at any moment."""
        trouble = self.soft_refusal
        if trouble is not None and trouble.status is Status.UNREACHABLE and trouble.detail != FULL:
            return self.policy.initial_ns
        return min(2 * self.wait_ns, self.policy.max_ns)


class Outbox(Flight[Key, _Pending]):
    """Pending messages and requests of an application process."""

    def __init__(self, hardware: int, platform: str = "", grace_ns: int = GRACE_NS) -> None:
        super().__init__(RetransmissionPolicy())
        self._hardware = hardware
        self._platform = platform
        self._grace_ns = grace_ns
        self._unanswered: Counter[tuple[int, int]] = Counter()
        """Number of messages by receiver's hardware and data id; requests are bounded by the receiver."""
        self._timers: Timers[Key] = Timers()
        self._rtt: defaultdict[_Way, RttEstimator] = defaultdict(RttEstimator)
        self.resent = 0
        """Frames sent more than once."""

    @staticmethod
    def key(frame: Frame) -> Key:
        """The key of a message or request."""
        return frame.sender_app, frame.data_id, frame.sequence

    def on_submit(self, frame: Frame, timeout_ns: int, now_ns: int) -> list[Action]:
        """A new message or request."""
        key, window = (frame.sender_app, frame.data_id, frame.sequence), (frame.receiver_hw, frame.data_id)
        if frame.kind is not FrameKind.REQUEST:
            if self._unanswered[window] >= WINDOW:
                detail = f"{WINDOW} messages wait for an answer"
                return [Complete(key, Outcome(Status.REFUSED, self._platform, detail))]
            self._unanswered[window] += 1
        policy = LOCAL if frame.receiver_hw == self._hardware else REMOTE
        # A known receiver starts with its measured round trip instead of the initial timeout.
        way = (frame.receiver_hw, frame.kind in _COMMANDS and not frame.flags & _BULK)
        round_trip = self._rtt.get(way)
        wait_ns = round_trip.timeout_ns(policy) if round_trip else policy.initial_ns
        expires_ns = now_ns + timeout_ns
        self.add(key, _Pending(frame, way, expires_ns, wait_ns, policy, sent_ns=now_ns))
        self._timers.set(key, min(now_ns + wait_ns, expires_ns))
        return [Transmit(frame)]

    def on_ack(self, key: Key, ack: Ack, now_ns: int) -> list[Action]:
        """An acknowledgement, or the refusal of a hop; unknown keys are duplicates."""
        pending = self.get(key)
        if pending is None:
            return []
        status = _STATUSES.get(ack.status, Status.REFUSED)
        outcome = Outcome(status, ack.where, ack.detail, ack.received_ns)
        # a hop reports the present state: a route may return before the time-out
        if status is Status.UNREACHABLE:
            pending.soft_refusal = outcome
            pending.absent_since_ns = None
            return []
        if status is Status.ABSENT:
            pending.soft_refusal = outcome
            if pending.absent_since_ns is None:
                pending.absent_since_ns = now_ns
            # at the answer, too: the timer may be set far later
            elif self._absent_for_good(pending, now_ns):
                return [self._give_up(key, pending)]
            return []
        if status is Status.DELIVERED and pending.frame.kind is FrameKind.REQUEST:
            # the receiver processes it: retransmit at the longest interval, in case the reply is lost
            pending.wait_ns = pending.policy.max_ns
            pending.absent_since_ns = pending.soft_refusal = None
            return []
        self.answered(key, now_ns)
        return [Complete(key, outcome)]

    def answered(self, key: Key, now_ns: int) -> None:
        """A message was answered, or a request, whose time includes its handler and is not a round trip."""
        pending = self.acknowledge(key, now_ns)
        round_trip_ns = None if pending is None else pending.round_trip_ns(now_ns)
        if pending is not None and round_trip_ns is not None and pending.frame.kind is not FrameKind.REQUEST:
            self._rtt[pending.way].add(round_trip_ns)

    def reached(self, key: Key) -> None:
        """The message was passed to a living application of this platform."""
        pending = self.get(key)
        if pending is not None:
            pending.reached = True
            pending.absent_since_ns = pending.soft_refusal = None

    def drop(self, key: Key) -> _Pending | None:
        """Remove a message or request that is answered, or whose sender does not wait any longer."""
        pending = super().drop(key)
        if pending is not None:
            self._timers.drop(key)
            if pending.frame.kind is not FrameKind.REQUEST:
                self._unanswered[pending.frame.receiver_hw, pending.frame.data_id] -= 1
        return pending

    def on_timer(self, now_ns: int) -> list[Action]:
        """Return retransmissions and outcomes that are due."""
        actions: list[Action] = []
        while (key := self._timers.pop(now_ns)) is not None:
            pending = self.get(key)
            if pending is None:
                continue
            # nothing waits for a retransmission after the time-out
            if now_ns >= pending.expires_ns or self._absent_for_good(pending, now_ns):
                actions.append(self._give_up(key, pending))
            else:
                self.resend(key, now_ns)
                self.resent += 1
                pending.wait_ns = pending.next_wait_ns()
                actions.append(Transmit(pending.frame))
                self._timers.set(key, self._next_ns(pending, now_ns))
        return actions

    def deadline_ns(self) -> int | None:
        """Instant at which `on_timer` must be called, or None without a deadline."""
        return self._timers.next_ns()

    def _next_ns(self, pending: _Pending, now_ns: int) -> int:
        due_ns = min(now_ns + pending.wait_ns, pending.expires_ns)
        if pending.absent_since_ns is not None:
            # in the future in any case: a deadline in the past would make the driver spin
            due_ns = min(due_ns, max(now_ns + 1, pending.absent_since_ns + self._grace_ns))
        return due_ns

    def _absent_for_good(self, pending: _Pending, now_ns: int) -> bool:
        return pending.absent_since_ns is not None and now_ns - pending.absent_since_ns >= self._grace_ns

    def _give_up(self, key: Key, pending: _Pending) -> Complete:
        self.drop(key)
        return Complete(key, _given_up(pending))


def _given_up(pending: _Pending) -> Outcome:
    trouble = pending.soft_refusal
    if trouble is None:
        return Outcome(Status.EXPIRED, detail=f"no answer after {pending.times_sent} tries")
    # a receiver that had the message has ended with it; the sender cannot know how far it came
    if trouble.status is Status.ABSENT:
        if pending.reached:
            return Outcome(Status.UNREACHABLE, trouble.where, "the receiver has ended without an answer")
        return Outcome(Status.REFUSED, trouble.where, trouble.detail)
    if trouble.detail == FULL:
        return Outcome(Status.EXPIRED, trouble.where, trouble.detail)
    return trouble
