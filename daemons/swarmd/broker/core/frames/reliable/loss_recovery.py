"""Packets in flight: which have arrived, which count as lost, and when to probe.

Time-outs include the time for which the processes of both ends wait for their processors; the round trip that
the window follows does not, because no queue of the link causes it.

Source: RFC 9002, sections 5 and 6. Three deviations, all for links that lose much: the time-out of a probe
doubles once only, because a link that is down is seen by its beacons; commands have a probe of their own,
which is earlier; and the threshold of reordering rises after a packet that arrived late.
"""

from typing import Final

import msgspec

from swarmd.broker.core.frames.reliable.packet import Acknowledgement, Piece
from swarmd.broker.core.frames.reliable.received_packets import ACK_DELAY_NS
from swarmware.transport.retransmission.rtt import RttEstimator

PACKET_THRESHOLD: Final = 3
PACKET_THRESHOLD_MAX: Final = 64
TIME_RATIO: Final = 9 / 8
TIME_RATIO_MAX: Final = 3.0
RELAXATION: Final = 0.01
"""Share of its excess by which the threshold of time falls with each acknowledgement."""
GRANULARITY_NS: Final = 1_000_000
FIRST_RTT_NS: Final = 100_000_000
"""Until a round trip was measured; RFC 9002 assumes 333 ms, for the whole Internet."""
SLACK_NS: Final = 15_000_000
"""Margin of a probe, within which the next packet's acknowledgement may arrive instead of a lost one. Of 30
packets a second at 10 % loss and 20 ms round trip 22 % are sent again with 4 ms, 13 % with 15 ms and with
25 ms; the slowest hundredth of commands needs longer with 25 ms."""
COMMAND_SLACK_NS: Final = 5_000_000
"""Margin of a probe while a command is in flight, because no further packet may follow it. Over three
hops with 30 % loss each way and 20 ms round trip 99 of 100 messages are confirmed within 0.58 s with 15 ms,
and `COMMAND_PROBES` of 0, and within 0.32 s with 5 ms and 3 (`tests/simulation/reliable/chain.py`)."""
COMMAND_PROBES: Final = 3
"""Probes for a command before their time-out doubles."""
BACKOFF_MAX: Final = 1
"""Doublings of the time-out of a probe: with two, a stream stopped for half a second at 40 % loss."""
LOST_KEPT: Final = 512
"""Lost packets that are remembered, to see that one was only late."""


class SentPacket(msgspec.Struct):
    """A packet in flight."""

    number: int
    size: int
    sent_ns: int
    pieces: tuple[Piece, ...]
    has_command: bool = False
    """A piece of a command is in it."""


class Settled(msgspec.Struct, frozen=True):
    """Packets that an acknowledgement, or time, has settled."""

    arrived: tuple[SentPacket, ...] = ()
    lost: tuple[SentPacket, ...] = ()
    late: int = 0
    """Packets that had counted as lost and have arrived."""
    round_trip_ns: int | None = None
    """From the sending of the newest packet to the arrival of its acknowledgement, without the time for which
    either end waited for its processor."""


class LossRecovery:
    """The packets in flight on one link, by number."""

    def __init__(self, first_rtt_ns: int) -> None:
        self._flight: dict[int, SentPacket] = {}
        self._lost: dict[int, None] = {}
        self._rtt = RttEstimator()
        self._first_rtt_ns = first_rtt_ns or FIRST_RTT_NS
        self._largest = -1
        """Highest number that was acknowledged."""
        self._packet_threshold = PACKET_THRESHOLD
        self._time_ratio = TIME_RATIO
        self._last_sent_ns = 0
        self._commands = 0
        """Packets in flight with commands."""
        self._command_sent_ns = 0
        """When the newest of them was sent, or probed."""
        self._loss_due_ns: int | None = None
        self.probes = 0
        """Probes in a row without an acknowledgement."""

    def __bool__(self) -> bool:
        return bool(self._flight)

    @property
    def smoothed_ns(self) -> int:
        """The smoothed round trip, or the first guess."""
        return self._rtt.smoothed_ns or self._first_rtt_ns

    @property
    def has_arrived(self) -> bool:
        """Whether a packet has been acknowledged."""
        return self._largest >= 0

    @property
    def oldest(self) -> SentPacket | None:
        """The packet that is in flight for the longest time, of those with commands if there are any."""
        if self._commands:
            return next(packet for packet in self._flight.values() if packet.has_command)
        return next(iter(self._flight.values()), None)

    def on_round_trip(self, round_trip_ns: int) -> None:
        """The round trip that was measured by another way: a probe before its end finds nothing."""
        if self._rtt.smoothed_ns:
            self._rtt.add(round_trip_ns)
        else:
            self._first_rtt_ns = round_trip_ns

    def on_sent(self, packet: SentPacket) -> None:
        """A packet that will be acknowledged is sent."""
        self._flight[packet.number] = packet
        self._last_sent_ns = packet.sent_ns
        if packet.has_command:
            self._commands += 1
            self._command_sent_ns = packet.sent_ns

    def on_acknowledgement(
        self, acknowledgement: Acknowledgement, now_ns: int, arrived_ns: int | None = None
    ) -> Settled:
        """Packets that arrived, and those that count as lost for it.

        `arrived_ns`: arrival of the acknowledgement, if it waited for this process.
        """
        flight = self._flight
        arrived: list[SentPacket] = []
        late = 0
        for first, last in acknowledgement.ranges:
            if last - first < len(flight):
                found = [number for number in range(first, last + 1) if number in flight]
            else:
                found = [number for number in flight if first <= number <= last]
            arrived += [self._land(number) for number in found]
            if self._lost:
                returned = [number for number in self._lost if first <= number <= last]
                for number in returned:
                    del self._lost[number]
                late += len(returned)
        if late:
            self._packet_threshold = min(self._packet_threshold << 1, PACKET_THRESHOLD_MAX)
            self._time_ratio = min(1.25 * self._time_ratio, TIME_RATIO_MAX)
        else:
            self._time_ratio += RELAXATION * (TIME_RATIO - self._time_ratio)
        round_trip_ns: int | None = None
        if arrived:
            newest = max(arrived, key=lambda packet: packet.number)
            self.probes = 0
            if newest.number == acknowledgement.largest:
                taken_ns = now_ns - newest.sent_ns
                delay_ns = min(acknowledgement.delay_ns, taken_ns)
                self._rtt.add(max(taken_ns - min(delay_ns, ACK_DELAY_NS), 1))
                waited_ns = 0 if arrived_ns is None else now_ns - arrived_ns
                round_trip_ns = max(taken_ns - delay_ns - waited_ns, 1)
        self._largest = max(self._largest, acknowledgement.largest)
        return Settled(tuple(arrived), self._detect(now_ns), late, round_trip_ns)

    def _land(self, number: int) -> SentPacket:
        """Removes a packet, which is not in flight any more."""
        packet = self._flight.pop(number)
        self._commands -= packet.has_command
        return packet

    def _detect(self, now_ns: int) -> tuple[SentPacket, ...]:
        """RFC 9002, section 6.1: lost by number, or by time."""
        wait_ns = max(round(self._time_ratio * self._rtt.worst_ns), GRANULARITY_NS)
        lost: list[SentPacket] = []
        self._loss_due_ns = None
        for packet in self._flight.values():
            if packet.number > self._largest:
                break
            overtaken = self._largest - packet.number >= self._packet_threshold
            if overtaken or now_ns - packet.sent_ns >= wait_ns:
                lost.append(packet)
            elif self._loss_due_ns is None:
                self._loss_due_ns = packet.sent_ns + wait_ns
        for packet in lost:
            self._land(packet.number)
            self._lost[packet.number] = None
        while len(self._lost) > LOST_KEPT:
            del self._lost[next(iter(self._lost))]
        return tuple(lost)

    def on_due(self, now_ns: int) -> tuple[tuple[SentPacket, ...], bool]:
        """The packets that count as lost now, and whether a probe is due."""
        if self._loss_due_ns is not None:
            return (self._detect(now_ns), False) if now_ns >= self._loss_due_ns else ((), False)
        due_ns = self._probe_ns()
        if due_ns is None or now_ns < due_ns:
            return (), False
        self.probes += 1
        self._command_sent_ns = now_ns  # also where every piece of the command has arrived
        return (), True

    def _probe_ns(self) -> int | None:
        if not self._flight:
            return None
        timeout_ns = self._rtt.smoothed_ns + max(4 * self._rtt.variation_ns, GRANULARITY_NS)
        if not self._rtt.smoothed_ns:
            timeout_ns = 2 * self._first_rtt_ns
        due_ns = self._last_sent_ns + (timeout_ns + SLACK_NS << min(self.probes, BACKOFF_MAX))
        if not self._commands:
            return due_ns
        doublings = max(0, min(self.probes - COMMAND_PROBES, BACKOFF_MAX))
        return min(due_ns, self._command_sent_ns + (timeout_ns + COMMAND_SLACK_NS << doublings))

    def deadline_ns(self) -> int | None:
        """When `on_due` must be called."""
        return self._loss_due_ns if self._loss_due_ns is not None else self._probe_ns()

    def clear(self) -> None:
        """Forgets the packets in flight."""
        self._flight.clear()
        self._lost.clear()
        self._commands = 0
        self._loss_due_ns = None
        self.probes = 0
