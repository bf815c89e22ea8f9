"""How much a connection may hold: little, more where it is the limit, much on a long way."""

import pytest

from swarmd.broker.core.frames.send_buffer import (
    FREE_NS,
    RATE_MAX_BYTES_S,
    SIZE_MAX,
    SIZE_MIN,
    TRIAL_AGAIN_NS,
    SendBuffer,
)
from swarmd.broker.core.swarm.links.link import ConnectionDelay

MS = 1_000_000
LOOK_NS = 40 * MS


class Link:
    """A link with a round trip and a rate, of which the kernel knows a former, shorter round trip."""

    def __init__(self, way_ns: int, rate_bytes_s: float, known_ns: int | None = None) -> None:
        self.buffer = SendBuffer()
        self.way_ns = way_ns
        self.rate_bytes_s = rate_bytes_s
        self.known_ns = way_ns if known_ns is None else known_ns
        self.now_ns = 0
        self.sizes: list[int] = []

    @property
    def delay(self) -> ConnectionDelay:
        """What lies in the buffer is on the way, or before the link."""
        full_ns = round(2 * self.buffer.size / self.rate_bytes_s * 1e9)
        return ConnectionDelay(max(self.way_ns, full_ns), self.known_ns)

    def look(self, times: int) -> int:
        """Looks while frames wait; the size at the end."""
        for _ in range(times):
            self.now_ns += LOOK_NS
            self.buffer.on_waiting(self.delay, self.now_ns)
            self.sizes.append(self.buffer.size)
        return self.buffer.size


def test_buffer_on_short_way_grows_to_limit() -> None:
    link = Link(2 * MS, 100e6)
    assert link.look(1) == round(1.5 * SIZE_MIN)
    assert link.look(10) == SIZE_MAX


@pytest.mark.parametrize("known_ns", [None, MS], ids=["from the start", "since a while"])
def test_a_long_way_gets_what_its_rate_needs(known_ns: int | None) -> None:
    link = Link(50 * MS, 100e6, known_ns)
    assert link.look(60) > 0.99 * RATE_MAX_BYTES_S * 0.05
    assert link.sizes[5] < SIZE_MAX, "a change is awaited before the next"


def test_trial_is_reverted_where_delay_is_own_queue() -> None:
    link = Link(MS, 200_000.0)  # 1.6 Mbit/s: 23 ms with the least buffer
    link.look(6)
    assert set(link.sizes) == {round(1.5 * SIZE_MIN), SIZE_MIN}
    assert link.buffer.size == SIZE_MIN
    tried = len(link.sizes)
    link.look(TRIAL_AGAIN_NS // LOOK_NS - 2)
    assert set(link.sizes[tried:]) == {SIZE_MIN}
    link.look(4)
    assert max(link.sizes[-3:]) > SIZE_MIN


def test_a_trial_during_which_nothing_waited_proves_nothing() -> None:
    link = Link(50 * MS, 100e6, MS)
    link.look(1)
    link.now_ns += 10 * TRIAL_AGAIN_NS
    assert link.look(1) == SIZE_MIN
    assert link.buffer.queue_ns(link.delay) == 49 * MS


def test_a_queue_makes_it_small_at_once() -> None:
    link = Link(50 * MS, 100e6)
    link.look(60)
    assert link.buffer.shrink() == SIZE_MIN
    assert link.look(1) > SIZE_MIN


def test_shortened_way_leaves_no_allowance_for_queue() -> None:
    link = Link(50 * MS, 100e6, MS)
    link.look(60)
    assert link.buffer.queue_ns(ConnectionDelay(50 * MS, MS)) == 0
    assert link.buffer.queue_ns(ConnectionDelay(2 * MS, MS)) == 0
    assert link.buffer.queue_ns(ConnectionDelay(50 * MS, MS)) > FREE_NS
