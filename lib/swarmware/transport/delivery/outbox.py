"""The sender's side: pending messages and requests, their retransmissions and time-outs."""

import heapq
from itertools import count
from typing import Final

import msgspec

from swarmware.model.frame import Flag, Frame, FrameKind
from swarmware.transport.delivery.outcome import FULL, Outcome, Status
from swarmware.transport.delivery.rtt import RetransmitLimits, RttEstimator
from swarmware.types.rpc import Ack

Key = tuple[int, int, int]
"""Application, data id, sequence: the fields of a question that its answer repeats."""

LOCAL: Final = RetransmitLimits(initial_ns=50_000_000, min_ns=50_000_000, max_ns=400_000_000)
"""Inside a platform a message is lost only with its receiver, or waits for a full inbox."""
REMOTE: Final = RetransmitLimits(initial_ns=300_000_000, min_ns=100_000_000, max_ns=2_400_000_000)
"""Between platforms, over radio links: 0.3, 0.6, 1.2 s until a round trip was measured."""

_STATUSES: Final = {int(status): status for status in Status}
_BULK: Final = int(Flag.BULK)
_COMMANDS: Final = frozenset({FrameKind.MESSAGE, FrameKind.REQUEST})

GRACE_NS: Final = 1_000_000_000
"""Time within which an absent receiver may appear: there is no start order (S0.37)."""


class Transmit(msgspec.Struct, frozen=True):
    """Send this frame, for the first time or again."""

    frame: Frame
    retransmission: bool
    """True for a retransmission: the receiver is looked up again, because it may have died."""


class Complete(msgspec.Struct, frozen=True):
    """Report the outcome to the sender."""

    key: Key
    outcome: Outcome


Action = Transmit | Complete


class _Pending(msgspec.Struct):
    frame: Frame
    expires_ns: int
    sent_ns: int
    wait_ns: int
    limits: RetransmitLimits
    times_sent: int = 1
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
            return self.limits.initial_ns
        return min(self.wait_ns * 2, self.limits.max_ns)


class Outbox:
    """Pending messages and requests of an application process."""

    def __init__(self, hardware: int, grace_ns: int = GRACE_NS) -> None:
        self._hardware = hardware
        self._grace_ns = grace_ns
        self._pending: dict[Key, _Pending] = {}
        self._due: list[tuple[int, int, Key]] = []
        self._order = count()
        self._rtt: dict[tuple[int, bool], RttEstimator] = {}
        self.resent = 0
        """Frames sent more than once."""

    def __len__(self) -> int:
        return len(self._pending)

    @staticmethod
    def key(frame: Frame) -> Key:
        """The key of a message or request."""
        return frame.sender_app, frame.data_id, frame.sequence

    def on_submit(self, frame: Frame, timeout_ns: int, now_ns: int) -> list[Action]:
        """A new message or request."""
        key = (frame.sender_app, frame.data_id, frame.sequence)
        pace = LOCAL if frame.receiver_hw == self._hardware else REMOTE
        # A known receiver starts with its measured round trip instead of the initial timeout.
        round_trip = self._rtt.get(_way(frame))
        wait_ns = round_trip.timeout_ns(pace) if round_trip else pace.initial_ns
        expires_ns = now_ns + timeout_ns
        self._pending[key] = _Pending(frame, expires_ns, now_ns, wait_ns, pace)
        self._schedule(key, min(now_ns + wait_ns, expires_ns))
        return [Transmit(frame, retransmission=False)]

    def on_ack(self, key: Key, ack: Ack, now_ns: int) -> list[Action]:
        """An acknowledgement, or the refusal of a hop; unknown keys are duplicates."""
        pending = self._pending.get(key)
        if pending is None:
            return []
        status = _STATUSES.get(ack.status, Status.REFUSED)
        outcome = Outcome(status, ack.where, ack.detail, ack.received_ns)
        if status is Status.UNREACHABLE:
            pending.soft_refusal = outcome
            pending.absent_since_ns = None
            return []
        if status is Status.ABSENT:
            pending.soft_refusal = outcome
            if pending.absent_since_ns is None:
                pending.absent_since_ns = now_ns
            elif self._absent_for_good(pending, now_ns):
                return [self._give_up(key, pending)]
            return []
        if status is Status.DELIVERED and pending.frame.kind is FrameKind.REQUEST:
            # the receiver processes it: retransmit at the longest interval, in case the reply is lost
            pending.wait_ns = pending.limits.max_ns
            pending.absent_since_ns = pending.soft_refusal = None
            return []
        self._measure(pending, now_ns)
        del self._pending[key]
        return [Complete(key, outcome)]

    def on_reply(self, key: Key, now_ns: int) -> list[Action]:
        """The reply to a request."""
        pending = self._pending.pop(key, None)
        if pending is not None:
            self._measure(pending, now_ns)
        return []

    def reached(self, key: Key) -> None:
        """The message was passed to a living application of this platform."""
        pending = self._pending.get(key)
        if pending is not None:
            pending.reached = True
            pending.absent_since_ns = pending.soft_refusal = None

    def drop(self, key: Key) -> None:
        """Remove a message or request whose sender does not wait any longer."""
        self._pending.pop(key, None)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Return retransmissions and outcomes that are due."""
        actions: list[Action] = []
        while self._due and self._due[0][0] <= now_ns:
            _, _, key = heapq.heappop(self._due)
            pending = self._pending.get(key)
            if pending is None:
                continue
            if now_ns >= pending.expires_ns or self._absent_for_good(pending, now_ns):
                actions.append(self._give_up(key, pending))
            else:
                pending.sent_ns = now_ns
                pending.times_sent += 1
                self.resent += 1
                pending.wait_ns = pending.next_wait_ns()
                actions.append(Transmit(pending.frame, retransmission=True))
                self._schedule(key, self._next_ns(pending, now_ns))
        return actions

    def deadline_ns(self) -> int | None:
        """Instant at which `on_timer` must be called, or None without a deadline."""
        # Answered entries stay in the heap until they surface: removing one inside it costs a full scan.
        while self._due and self._due[0][2] not in self._pending:
            heapq.heappop(self._due)
        return self._due[0][0] if self._due else None

    def _next_ns(self, pending: _Pending, now_ns: int) -> int:
        due_ns = min(now_ns + pending.wait_ns, pending.expires_ns)
        if pending.absent_since_ns is not None:
            due_ns = min(due_ns, max(now_ns + 1, pending.absent_since_ns + self._grace_ns))
        return due_ns

    def _absent_for_good(self, pending: _Pending, now_ns: int) -> bool:
        return pending.absent_since_ns is not None and now_ns - pending.absent_since_ns >= self._grace_ns

    def _give_up(self, key: Key, pending: _Pending) -> Complete:
        del self._pending[key]
        return Complete(key, _given_up(pending))

    def _measure(self, pending: _Pending, now_ns: int) -> None:
        if pending.times_sent != 1 or pending.frame.kind is FrameKind.REQUEST:
            return  # Karn: the answered copy is unknown; the time of a request includes its handler
        way = _way(pending.frame)
        estimator = self._rtt.get(way)
        if estimator is None:
            estimator = self._rtt[way] = RttEstimator()
        estimator.add(now_ns - pending.sent_ns)

    def _schedule(self, key: Key, due_ns: int) -> None:
        heapq.heappush(self._due, (due_ns, next(self._order), key))


def _way(frame: Frame) -> tuple[int, bool]:
    """Key of a shared round-trip time: commands do not wait behind notifications and streams."""
    return frame.receiver_hw, frame.kind in _COMMANDS and not frame.flags & _BULK


def _given_up(pending: _Pending) -> Outcome:
    trouble = pending.soft_refusal
    if trouble is None:
        return Outcome(Status.EXPIRED, detail=f"no answer after {pending.times_sent} tries")
    if trouble.status is Status.ABSENT:
        if pending.reached:
            return Outcome(Status.UNREACHABLE, trouble.where, "the receiver has ended without an answer")
        return Outcome(Status.REFUSED, trouble.where, trouble.detail)
    if trouble.detail == FULL:
        return Outcome(Status.EXPIRED, trouble.where, trouble.detail)
    return trouble
