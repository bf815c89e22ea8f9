"""Numbered packets in flight: which have arrived, which count as lost, and when to probe.

Time-outs include the time for which the processes of both ends wait for their processors; the round trip that
the window follows does not, because no queue of the link causes it.

Source: RFC 9002, sections 5 and 6. Three deviations, all for links that lose much: the time-out of a probe
doubles a few times only, because a link that is down is seen by other means; urgent packets have a probe of
their own, which is earlier; and the threshold of reordering rises after a packet that arrived late.
"""

from collections.abc import Sequence
from typing import Generic, TypeVar

import msgspec

from swarmware.transport.retransmission.flight import Flight, Sent
from swarmware.transport.retransmission.policy import RetransmissionPolicy
from swarmware.transport.retransmission.rtt import RttEstimator


class SentPacket(Sent):
    """A packet in flight."""

    number: int
    is_urgent: bool
    """True if a probe of the packet is due early, because no next packet need follow."""


Packet = TypeVar("Packet", bound=SentPacket)


class Settled(msgspec.Struct, Generic[Packet], frozen=True):
    """Outcome of packets by an acknowledgement."""

    arrived: list[Packet]
    lost: list[Packet]
    late: int
    """Packets that had counted as lost and have arrived."""
    round_trip_ns: int | None
    """From the sending of the newest packet to the arrival of its acknowledgement, without the time for which
    either end waited for its processor."""


class LossDetection(Flight[int, Packet]):
    """The packets in flight on one link, by number; each probe is a failure of the flight."""

    def __init__(self, policy: RetransmissionPolicy, first_rtt_ns: int) -> None:
        """`first_rtt_ns`: first guess, or 0 if unknown."""
        super().__init__(policy)
        self._lost: dict[int, None] = {}
        self._rtt = RttEstimator()
        self._first_rtt_ns = first_rtt_ns or policy.initial_ns // 2
        self._largest = -1
        """Highest number that was acknowledged."""
        self._packet_threshold = policy.packet_threshold
        self._time_ratio = policy.time_ratio
        self._urgent = 0
        """Urgent packets in flight."""
        self._urgent_sent_ns = 0
        """Instant at which the newest of the urgent packets was sent, or probed."""
        self._loss_due_ns: int | None = None

    @property
    def smoothed_ns(self) -> int:
        """The smoothed round trip, or the first guess."""
        return self._rtt.smoothed_ns or self._first_rtt_ns

    @property
    def to_probe(self) -> Packet | None:
        """The oldest packet in flight, of the urgent ones if there are any."""
        return next((packet for packet in self if packet.is_urgent or not self._urgent), None)

    def on_round_trip(self, round_trip_ns: int) -> None:
        """The round trip that was measured by another way: a probe before its end finds nothing."""
        if self._rtt.smoothed_ns:
            self._rtt.add(round_trip_ns)
        else:
            self._first_rtt_ns = round_trip_ns

    def on_sent(self, packet: Packet) -> None:
        """A packet that will be acknowledged is sent."""
        self.add(packet.number, packet)
        if packet.is_urgent:
            self._urgent += 1
            self._urgent_sent_ns = packet.sent_ns

    def drop(self, key: int) -> Packet | None:
        """Remove a packet, which is not in flight any more."""
        packet = super().drop(key)
        self._urgent -= packet is not None and packet.is_urgent
        return packet

    def on_acknowledgement(
        self,
        ranges: Sequence[tuple[int, int]],
        delay_ns: int,
        now_ns: int,
        arrived_ns: int | None = None,
    ) -> Settled[Packet]:
        """Packets that arrived, and those that count as lost for it.

        Shapes: `ranges`: first and last numbers that arrived, the newest range first. `delay_ns`: from the
        arrival of the newest packet to the acknowledgement. `arrived_ns`: arrival of the acknowledgement, if
        it waited for this process.
        """
        policy, largest = self._policy, ranges[0][1]
        arrived: list[Packet] = []
        late = 0
        for first, last in ranges:
            # a huge acknowledged range is not counted through: the loop is then over the packets in flight
            if last - first < len(self):
                found = [packet for number in range(first, last + 1) if (packet := self._items.get(number))]
            else:
                found = [packet for packet in self if first <= packet.number <= last]
            for packet in found:
                self.acknowledge(packet.number, now_ns)
            arrived += found
            returned = [number for number in self._lost if first <= number <= last]
            for number in returned:
                del self._lost[number]
            late += len(returned)
        if late:
            self._packet_threshold = min(self._packet_threshold << 1, policy.packet_threshold_max)
            self._time_ratio = min(1.25 * self._time_ratio, policy.time_ratio_max)
        else:
            self._time_ratio += policy.time_relaxation * (policy.time_ratio - self._time_ratio)
        round_trip_ns: int | None = None
        newest = max(arrived, key=lambda packet: packet.number, default=None)
        if newest is not None and newest.number == largest:
            taken_ns = now_ns - newest.sent_ns
            delay_ns = min(delay_ns, taken_ns)
            self._rtt.add(max(taken_ns - min(delay_ns, policy.ack_delay_ns), 1))
            waited_ns = 0 if arrived_ns is None else now_ns - arrived_ns
            round_trip_ns = max(taken_ns - delay_ns - waited_ns, 1)
        self._largest = max(self._largest, largest)
        return Settled(arrived, self._detect(now_ns), late, round_trip_ns)

    def _detect(self, now_ns: int) -> list[Packet]:
        """RFC 9002, section 6.1: lost by number, or by time."""
        wait_ns = max(round(self._time_ratio * self._rtt.worst_ns), self._policy.granularity_ns)
        lost: list[Packet] = []
        self._loss_due_ns = None
        for packet in self:
            if packet.number > self._largest:
                break
            overtaken = self._largest - packet.number >= self._packet_threshold
            if overtaken or now_ns - packet.sent_ns >= wait_ns:
                lost.append(packet)
            elif self._loss_due_ns is None:
                self._loss_due_ns = packet.sent_ns + wait_ns
        for packet in lost:
            self.drop(packet.number)
            self._lost[packet.number] = None
        while len(self._lost) > self._policy.lost_kept:
            del self._lost[next(iter(self._lost))]
        return lost

    def on_due(self, now_ns: int) -> tuple[list[Packet], bool]:
        """The packets that count as lost now, and whether a probe is due."""
        if self._loss_due_ns is not None:
            return (self._detect(now_ns), False) if now_ns >= self._loss_due_ns else ([], False)
        due_ns = self._probe_ns()
        if due_ns is None or now_ns < due_ns:
            return [], False
        self.failures += 1
        self._urgent_sent_ns = now_ns  # also where another packet has brought its content
        return [], True

    def _probe_ns(self) -> int | None:
        if not self:
            return None
        policy, limit = self._policy, self._policy.doublings_max
        timeout_ns = self._rtt.timeout_ns(policy) if self._rtt.smoothed_ns else 2 * self._first_rtt_ns
        due_ns = self.sent_ns + (timeout_ns + policy.slack_ns << min(self.failures, limit))
        if not self._urgent:
            return due_ns
        doublings = max(0, min(self.failures - policy.urgent_probes, limit))
        return min(due_ns, self._urgent_sent_ns + (timeout_ns + policy.urgent_slack_ns << doublings))

    def deadline_ns(self) -> int | None:
        """Instant at which `on_due` must be called, or None without a deadline."""
        return self._loss_due_ns if self._loss_due_ns is not None else self._probe_ns()

    def clear(self) -> None:
        """Remove all packets in flight, and forget lost packets."""
        super().clear()
        self._lost.clear()
        self._urgent = 0
        self._loss_due_ns = None
