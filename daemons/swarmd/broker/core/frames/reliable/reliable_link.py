"""One reliable link: frames in both directions between this node and a session of a neighbour."""

from typing import Final

from swarmd.broker.core.frames.reliable.link_action import (
    DeliverFrame,
    FrameBegun,
    FramesDropped,
    LinkAction,
    SendPacket,
)
from swarmd.broker.core.frames.reliable.outgoing import COMMANDS, ROOM, OutgoingMessages
from swarmd.broker.core.frames.reliable.packet import (
    NUMBER_MAX,
    Acknowledgement,
    Packet,
    Piece,
    acknowledgement_bytes,
    decode,
    encode,
    piece_bytes,
)
from swarmd.broker.core.frames.reliable.reassembly import Reassembly
from swarmd.broker.core.frames.reliable.received_packets import ACK_DELAY_NS, ReceivedPackets
from swarmd.broker.core.frames.send_queue import Priority, QueuedFrame
from swarmware.errors import WireError
from swarmware.transport.retransmission.loss_detection import LossDetection, SentPacket
from swarmware.transport.retransmission.policy import RetransmissionPolicy
from swarmware.transport.retransmission.rate_control import RateControl

OVERHEAD: Final = 28 + 10 + 16
"""Bytes of a datagram besides the packet: IP and UDP, clear header, tag."""
ALL: Final = tuple(Priority)
PROBES: Final = 2
"""Copies of the oldest packet, from the second probe on (RFC 9002, section 6.2.4)."""
SILENCE: Final = 6
"""Probes in a row without an acknowledgement after which less is sent; at 40 % loss less than one loss in a
hundred has this consequence."""
BLOCKED: Final = 24
"""Probes in a row without an acknowledgement after which the neighbour does not get the datagrams, which are
blocked on the way, or unknown to it."""
BLOCKED_LATER: Final = 96
"""Probes in a row that show a block after the neighbour has acknowledged packets. A busy computer may
not answer for a second, and a connection that is opened over a lossy link needs several."""

FULL: Final = 8
"""Frames that wait to begin, from which on the rate of the link is the limit."""

LINK: Final = RetransmissionPolicy(
    initial_ns=200_000_000,  # RFC 9002 assumes 666 ms, for the whole Internet
    granularity_ns=1_000_000,
    ack_delay_ns=ACK_DELAY_NS,
    slack_ns=15_000_000,
    urgent_slack_ns=5_000_000,
    urgent_probes=3,
    doublings_max=1,  # with two, a stream stopped for half a second at 40 % loss
)
"""Packets with commands are urgent.

Of 30 packets a second at 10 % loss and 20 ms round trip 22 % are sent again with a slack of 4 ms, 13 % with
15 ms and with 25 ms; the slowest hundredth of commands needs longer with 25 ms. Over three hops with 30 %
loss each way and 20 ms round trip 99 of 100 messages are confirmed within 0.58 s with an urgent slack of
15 ms and no urgent probes, and within 0.32 s with 5 ms and 3 (`tests/simulation/reliable/chain.py`).
"""


class _LinkPacket(SentPacket):
    pieces: tuple[Piece, ...]


class ReliableLink:
    """Sends frames as pieces in packets until they arrive, and joins the pieces of arriving frames."""

    def __init__(
        self, hw: int, session: int, rtt_ns: int, loss: float, now_ns: int, base_ns: int | None = None
    ) -> None:
        """`rtt_ns`, `loss`, `base_ns`: of the beacons, as a first guess; 0 or None: not known."""
        self.hw = hw
        self.session = session
        self.rate = RateControl(now_ns, loss, base_ns)
        self._outgoing = OutgoingMessages()
        self._recovery = LossDetection[_LinkPacket](LINK, rtt_ns)
        self._received = ReceivedPackets()
        self._incoming = Reassembly()
        self._next_number = 0
        self._paced_until_ns: int | None = None
        self._counted = 0, 0
        """Repeated bytes and acknowledged frames at the last call of `take_counts`."""

    def __len__(self) -> int:
        """Frames that have not arrived."""
        return len(self._outgoing)

    @property
    def is_blocked(self) -> bool:
        """Whether its datagrams do not reach the neighbour, although its beacons arrive."""
        limit = BLOCKED_LATER if self._recovery.arrived_ns >= 0 else BLOCKED
        return self._recovery.failures >= limit or self._next_number >= NUMBER_MAX - ROOM

    @property
    def is_full(self) -> bool:
        """Whether frames wait because the link is slower than they come."""
        return self._outgoing.waiting > FULL

    @property
    def repeated_bytes(self) -> int:
        """Bytes of pieces that were sent again."""
        return self._outgoing.repeated_bytes

    def take_counts(self) -> tuple[int, int]:
        """Repeated bytes and acknowledged frames since the last call."""
        outgoing, (repeated_bytes, arrived_frames) = self._outgoing, self._counted
        self._counted = outgoing.repeated_bytes, outgoing.arrived_frames
        return outgoing.repeated_bytes - repeated_bytes, outgoing.arrived_frames - arrived_frames

    @property
    def waiting_bytes(self) -> int:
        """Bytes of the frames that have not arrived."""
        return self._outgoing.waiting_bytes

    def on_queue(self, rtt_ns: int) -> None:
        """Takes the present round trip of a link whose queue is full of frames that took a connection."""
        self.rate.on_queue()
        self._recovery.on_round_trip(rtt_ns)

    def on_frame(self, queued: QueuedFrame, now_ns: int) -> list[LinkAction]:
        """A frame for the neighbour."""
        gone = self._outgoing.put(queued)
        actions: list[LinkAction] = [FramesDropped(self.hw, gone)] if gone else []
        return actions + self._send(now_ns)

    def on_packet(self, data: bytes, now_ns: int, arrived_ns: int | None = None) -> list[LinkAction]:
        """A packet of the neighbour, authenticated and not a replay.

        `arrived_ns`: its arrival, if it waited for this process.
        Raises: WireError for a packet that no correct neighbour sends.
        """
        packet = decode(data)
        # checked before anything is taken from the packet; a faulty one must change nothing
        self._check(packet.acknowledgement)
        frames = self._take_pieces(packet, now_ns, arrived_ns)
        actions: list[LinkAction] = [DeliverFrame(self.hw, frame) for frame in frames]
        if packet.acknowledgement is not None:
            self._on_acknowledgement(packet.acknowledgement, now_ns, arrived_ns)
        return actions + self._send(now_ns)

    def _check(self, acknowledgement: Acknowledgement | None) -> None:
        if acknowledgement is not None and acknowledgement.largest >= self._next_number:
            raise WireError(f"acknowledgement of packet {acknowledgement.largest}, which was not sent")

    def _take_pieces(self, packet: Packet, now_ns: int, arrived_ns: int | None) -> list[bytes]:
        if not self._incoming.has_room(packet.pieces):
            return []  # it is not acknowledged, and will be repeated
        # messages below the floor have arrived or were given up; what is kept of them is dropped
        self._incoming.on_floor(packet.floor)
        whole = [self._incoming.on_piece(piece) for piece in packet.pieces]
        self._received.on_packet(packet.number, packet.is_answered, now_ns, arrived_ns)
        return [frame for frame in whole if frame is not None]

    def _on_acknowledgement(
        self, acknowledgement: Acknowledgement, now_ns: int, arrived_ns: int | None
    ) -> None:
        settled = self._recovery.on_acknowledgement(
            acknowledgement.ranges, acknowledgement.delay_ns, now_ns, arrived_ns
        )
        rate = self.rate
        for packet in settled.arrived:
            rate.on_acknowledged(packet.size)
            for piece in packet.pieces:
                self._outgoing.on_arrived(piece)
        self._on_lost(settled.lost)
        # the window was reduced for a loss that did not happen
        for _ in range(settled.late):
            rate.on_spurious()
        if settled.round_trip_ns is not None:
            rate.on_round_trip(settled.round_trip_ns, now_ns)
        rate.on_round(self._recovery.smoothed_ns, now_ns)

    def _on_lost(self, packets: list[_LinkPacket]) -> None:
        for packet in packets:
            self.rate.on_lost(packet.size)
            for piece in packet.pieces:
                self._outgoing.on_lost(piece)

    def on_due(self, now_ns: int) -> list[LinkAction]:
        """Packets that count as lost, probes, acknowledgements and paced packets that are due."""
        lost, probe = self._recovery.on_due(now_ns)
        self._on_lost(lost)
        actions: list[LinkAction] = []
        if probe:
            if self._recovery.failures == SILENCE:
                self.rate.on_silence()
            actions = self._probe(now_ns)
        return actions + self._send(now_ns)

    def _probe(self, now_ns: int) -> list[LinkAction]:
        """Repeats the oldest packet in flight, beyond the window."""
        oldest = self._recovery.to_probe
        # after one lost probe several copies; at high loss a single one is probably lost, too
        copies = 1 if self._recovery.failures == 1 else PROBES
        pieces = self._outgoing.repeat(oldest.pieces if oldest is not None else (), copies)
        return [self._packet(pieces, now_ns, ping=not pieces) for _ in range(copies)]

    def _send(self, now_ns: int) -> list[LinkAction]:
        """All packets that window and pace allow, and the acknowledgement that is due."""
        outgoing, rate = self._outgoing, self.rate
        actions: list[LinkAction] = []
        self._paced_until_ns = None
        while True:
            ranks: tuple[Priority, ...] = ()
            # commands may use a part of the window that other frames must leave free, and are not paced
            if outgoing.has(COMMANDS) and rate.has_room(reserve=True):
                ranks = COMMANDS
            if not outgoing.has(ALL):
                break
            if not rate.has_room(reserve=False):
                # the window, not the application, limits the rate; only then may it grow
                rate.on_limited()
            else:
                wait_ns = rate.wait_ns(self._recovery.smoothed_ns, now_ns)
                if not wait_ns:
                    ranks = ALL
                else:
                    self._paced_until_ns = now_ns + wait_ns
            pieces = self._pieces(ranks, now_ns, actions) if ranks else []
            if not pieces:
                break
            actions.append(self._packet(tuple(pieces), now_ns))
        due_ns = self._received.due_ns
        if due_ns is not None and now_ns >= due_ns:
            actions.append(self._packet((), now_ns))
        return actions

    def _pieces(self, ranks: tuple[Priority, ...], now_ns: int, actions: list[LinkAction]) -> list[Piece]:
        pieces: list[Piece] = []
        room = ROOM
        while True:
            piece, begun, gone = self._outgoing.take(ranks, room, now_ns)
            if gone:
                actions.append(FramesDropped(self.hw, gone))
            if begun is not None:
                actions.append(FrameBegun(self.hw, begun))
            if piece is None:
                return pieces
            pieces.append(piece)
            room = ROOM - _bytes_of(pieces)

    def _packet(self, pieces: tuple[Piece, ...], now_ns: int, ping: bool = False) -> SendPacket:
        acknowledgement = self._received.present(now_ns)
        # pieces go first, since an acknowledgement can wait for a packet of its own
        if acknowledgement is not None and pieces:
            room = ROOM - _bytes_of(pieces)
            if acknowledgement_bytes(acknowledgement) > room:
                acknowledgement = None  # it follows in a packet of its own
        packet = Packet(self._next_number, self._outgoing.floor, acknowledgement, pieces, ping)
        self._next_number += 1
        if acknowledgement is not None:
            self._received.on_acknowledged()
        data = encode(packet)
        # a bare acknowledgement is not acknowledged in turn, and is in no window
        if packet.is_answered:
            size = len(data) + OVERHEAD
            has_command = self._outgoing.has_command(pieces)
            self._recovery.on_sent(_LinkPacket(packet.number, has_command, pieces, sent_ns=now_ns, size=size))
            self.rate.on_sent(size)
        return SendPacket(self.hw, self.session, data)

    def deadline_ns(self) -> int | None:
        """When `on_due` must be called, or None without a deadline."""
        instants = (self._received.due_ns, self._recovery.deadline_ns(), self._paced_until_ns)
        return min((one for one in instants if one is not None), default=None)

    def clear(self, now_ns: int) -> list[QueuedFrame]:
        """Gives up what is being sent; the frames that have not arrived.

        The numbers continue: the neighbour may have kept its end of the link.
        """
        self._recovery.clear()
        # the next session of the link is measured again from its start
        self.rate = RateControl(now_ns)
        self._paced_until_ns = None
        return self._outgoing.clear()


def _bytes_of(pieces: list[Piece] | tuple[Piece, ...]) -> int:
    return sum(piece_bytes(piece) for piece in pieces)
