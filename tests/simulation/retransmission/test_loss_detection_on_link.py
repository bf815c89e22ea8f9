"""Numbered packets over a link that loses, delays and reorders them, in virtual time."""

from collections import Counter
from functools import partial
from random import Random

import pytest

from swarmware.testing.virtual import VirtualTime
from swarmware.transport.retransmission.loss_detection import LossDetection, SentPacket
from swarmware.transport.retransmission.policy import RetransmissionPolicy
from swarmware.transport.retransmission.received_numbers import ReceivedNumbers

MS = 1_000_000
S = 1000 * MS
POLICY = RetransmissionPolicy(initial_ns=200 * MS, granularity_ns=MS, slack_ns=15 * MS, doublings_max=1)
ITEMS = 600
PERIOD_NS = 10 * MS


class _ItemPacket(SentPacket):
    item: int


class Link:
    """A sender of items, one in each period, and a receiver that acknowledges every packet."""

    def __init__(self, seed: int, loss: float, jitter_ms: float) -> None:
        self._draw, self._loss, self._jitter_ms = Random(seed), loss, jitter_ms
        self.time = VirtualTime(S)
        self.detection: LossDetection[_ItemPacket] = LossDetection(POLICY, 0)
        self._received = ReceivedNumbers()
        self._packets = 0
        self.arrived: Counter[int] = Counter()
        """Copies of each item at the receiver."""
        self.late = 0
        for item in range(ITEMS):
            self.time.at(S + item * PERIOD_NS, partial(self._send, item))
        self.time.every(0.001, self._tick)

    def _carry(self, action: partial[None]) -> None:
        if self._draw.random() >= self._loss:
            delay_ms = 10 + self._draw.random() * self._jitter_ms
            self.time.at(self.time.now_ns + round(delay_ms * MS), action)

    def _send(self, item: int) -> None:
        number = self._packets
        self._packets += 1
        self.detection.on_sent(_ItemPacket(number, False, item, sent_ns=self.time.now_ns))
        self._carry(partial(self._on_packet, number, item))

    def _on_packet(self, number: int, item: int) -> None:
        self.arrived[item] += 1
        self._received.add(number)
        newest = [one for one in range(max(0, number - 40), number + 1) if one in self._received]
        self._carry(partial(self._on_acknowledgement, [(one, one) for one in reversed(newest)]))

    def _on_acknowledgement(self, ranges: list[tuple[int, int]]) -> None:
        settled = self.detection.on_acknowledgement(ranges, 0, self.time.now_ns)
        self.late += settled.late
        for packet in settled.lost:
            self._send(packet.item)

    def _tick(self) -> None:
        """Send again what is due now."""
        lost, is_probe = self.detection.on_due(self.time.now_ns)
        oldest = self.detection.to_probe
        for packet in [oldest] if is_probe and oldest is not None else lost:
            self._send(packet.item)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("loss", "jitter_ms"), [(0.0, 0.0), (0.1, 2.0), (0.3, 2.0), (0.4, 8.0), (0.1, 60.0)])
def test_every_item_arrives_with_few_copies(seed: int, loss: float, jitter_ms: float) -> None:
    link = Link(seed, loss, jitter_ms)
    link.time.run_until(S + ITEMS * PERIOD_NS + 5 * S)
    assert set(link.arrived) == set(range(ITEMS))
    assert not link.detection, "nothing stays in flight"
    copies = sum(link.arrived.values())
    if loss == 0.0:
        assert copies == ITEMS
    # a lost acknowledgement costs a copy only where no later one arrives in time
    assert copies < ITEMS * (1.15 + loss)
    assert link.late < ITEMS * (0.1 + loss), "reordering raises the threshold"
