"""Sessions and clocks of the origins of relayed frames: a recorded frame is not taken again."""

import struct
from enum import Enum
from typing import Final, Generic, TypeVar

import msgspec

FRAME_AGE_NS: Final = 50_000_000_000
"""Maximum age of a relayed frame without a lifetime: the receiver remembers for 60 s what it has received."""
QUESTION_NS: Final = 250_000_000
"""Minimum period between questions to one origin: shorter than the time until a sender retransmits, so that
a lost question does not cost a second one."""
ANSWER_NS: Final = 10_000_000_000
"""Time for which the answer to a question is taken."""
RENEWAL_NS: Final = 3_600_000_000_000
"""Age after which the clock of an origin is asked again, since the bound below falls behind it."""
RATE_DIVISOR: Final = 500
"""Two clocks of ±500 ppm (`ClockConfig`) differ by 1/1000 in rate; twice that counts."""
HELD_MAX: Final = 64
"""Maximum frames of all origins that wait for an answer."""
ORIGINS_MAX: Final = 4096

_QUESTION: Final = 1
_ANSWER: Final = 2
_CHECK: Final = struct.Struct("<BQI")
"""Payload of a check: question or answer, session of the asking node, number of the question."""
CHECK_BYTES: Final = _CHECK.size

T = TypeVar("T")


class Freshness(Enum):
    """Whether a signed frame was made recently."""

    CURRENT = 1
    UNKNOWN = 2
    """The session of its origin is not confirmed: ask."""
    STALE = 3
    """Made too long ago, or in a former session of its origin."""


class _Origin(msgspec.Struct, gc=False):
    session: int
    stamp_ns: int
    """A reading of the origin's clock, …"""
    at_ns: int
    """… which it showed at this instant of the own clock, or earlier."""

    def clock_ns(self, now_ns: int) -> int:
        """Lower bound of the origin's clock."""
        elapsed_ns = now_ns - self.at_ns
        return self.stamp_ns + elapsed_ns - elapsed_ns // RATE_DIVISOR


class _Question(msgspec.Struct, gc=False):
    number: int
    first_ns: int
    sent_ns: int


class Origins(Generic[T]):
    """Confirmed sessions of the origins of relayed frames, and a lower bound of each one's clock.

    A signature proves who made a frame, not when. An origin confirms its session by a signed answer to a
    question with a number of this session; from then on the stamps of its frames must be near its clock.
    """

    def __init__(self, own_session: int) -> None:
        self._own_session = own_session
        self._origins: dict[int, _Origin] = {}
        self._questions: dict[int, _Question] = {}
        self._held: list[tuple[int, int, T]] = []
        self._number = 0

    def judge(self, hw: int, session: int, stamp_ns: int, lifetime_ns: int | None, now_ns: int) -> Freshness:
        """Judge a frame of this origin, whose signature is genuine."""
        origin = self._origins.get(hw)
        # sessions rise with each start; a higher one may be genuine, and has to prove itself
        if origin is None or session > origin.session:
            return Freshness.UNKNOWN
        if session < origin.session:
            return Freshness.STALE
        clock_ns = origin.clock_ns(now_ns)
        age_ns = FRAME_AGE_NS if lifetime_ns is None else lifetime_ns
        if stamp_ns + age_ns < clock_ns:
            return Freshness.STALE
        # a genuine stamp ahead of the bound raises the bound
        if stamp_ns > clock_ns:
            origin.stamp_ns, origin.at_ns = stamp_ns, now_ns
        # the bound falls behind the clock with time, by its assumed drift; it is measured again
        elif now_ns - origin.at_ns > RENEWAL_NS:
            return Freshness.UNKNOWN
        return Freshness.CURRENT

    def question(self, hw: int, now_ns: int) -> bytes | None:
        """Payload of the question to an origin, or None if it was asked a moment ago."""
        asked = self._questions.get(hw)
        if asked is not None and now_ns - asked.sent_ns < QUESTION_NS:
            return None
        # a new number, because a late answer to the former question must not count
        if asked is None or now_ns - asked.first_ns > ANSWER_NS:
            self._number = self._number + 1 & 0xFFFF_FFFF
            if len(self._questions) >= ORIGINS_MAX:
                del self._questions[next(iter(self._questions))]
            asked = self._questions[hw] = _Question(self._number, now_ns, now_ns)
        asked.sent_ns = now_ns
        return _CHECK.pack(_QUESTION, self._own_session, asked.number)

    def is_confirmed(self, hw: int, session: int) -> bool:
        """Whether this is the confirmed session of an origin."""
        origin = self._origins.get(hw)
        return origin is not None and origin.session == session

    def on_answer(self, hw: int, session: int, check: bytes, stamp_ns: int, now_ns: int) -> list[T]:
        """Take an answer with a genuine signature; returns the frames of that session that waited for it."""
        _, own_session, number = _CHECK.unpack(check)
        asked = self._questions.get(hw)
        if asked is None or own_session != self._own_session or number != asked.number:
            return []
        del self._questions[hw]
        # the bound of the clock would be off by as much as the answer was under way
        if now_ns - asked.first_ns > ANSWER_NS:
            return []
        self._origins.pop(hw, None)
        if len(self._origins) >= ORIGINS_MAX:
            del self._origins[next(iter(self._origins))]
        self._origins[hw] = _Origin(session, stamp_ns, now_ns)
        waiting = [item for origin, held, item in self._held if (origin, held) == (hw, session)]
        self._held = [one for one in self._held if one[0] != hw]
        return waiting

    def hold(self, hw: int, session: int, item: T) -> None:
        """Keep a frame until its origin has answered; the oldest is dropped where there are too many."""
        self._held.append((hw, session, item))
        del self._held[:-HELD_MAX]


def is_check(payload: bytes | memoryview) -> bool:
    """Whether this is the payload of a question or of an answer."""
    return len(payload) == CHECK_BYTES and payload[0] in (_QUESTION, _ANSWER)


def answer_to(check: bytes) -> bytes | None:
    """Payload of the answer to a question, or None for a check that is an answer itself."""
    kind, session, number = _CHECK.unpack(check)
    return _CHECK.pack(_ANSWER, session, number) if kind == _QUESTION else None
