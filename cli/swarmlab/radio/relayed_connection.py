"""A TCP connection between two nodes: both its ends on loopback, and the two directions over the radio."""

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Final

from swarmlab.radio.core.relay_packet import PacketKind, RelayPacket
from swarmlab.radio.core.segments import Segment, SegmentReceiver, SegmentSender

Send = Callable[[int, Sequence[RelayPacket]], None]
"""Gives packets to the radio: index of the receiver, packets."""
_NOTHING: Final = b""


class ConnectionEnd(asyncio.Protocol):
    """The end of a relayed connection at one node."""

    def __init__(self, connection: "RelayedConnection", node: int) -> None:
        self._connection = connection
        self.node = node
        self.sender = SegmentSender()
        """Of what this node sends."""
        self.receiver = SegmentReceiver()
        """Of what this node gets."""
        self.transport: asyncio.Transport | None = None
        self.is_lost = False
        """Whether its socket is closed."""
        self.has_ended = False
        """Whether it sends nothing more."""
        self._is_shut = False
        """Whether the other node sends nothing more."""
        self._waiting: list[bytes] = []
        """Bytes that arrived before its socket was connected; an empty entry is the end."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        waiting, self._waiting = self._waiting, []
        for data in waiting:
            self.give(data)
        self._connection.on_made(self)

    def data_received(self, data: bytes) -> None:
        self.sender.put(data)
        if self.sender.is_full and self.transport is not None:
            self.transport.pause_reading()
        self._connection.transmit(self)

    def eof_received(self) -> bool:
        self.end()
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        self.is_lost = True
        self.transport = None
        self.end()
        self._connection.on_lost()

    def pause_writing(self) -> None:
        self._connection.hold(self, held=True)

    def resume_writing(self) -> None:
        self._connection.hold(self, held=False)

    def give(self, data: bytes) -> None:
        """Writes bytes to the node; without any, that the other one sends nothing more."""
        if self.is_lost:
            return
        if self.transport is None:
            self._waiting.append(data)
        elif data:
            self.transport.write(data)
        else:
            self._is_shut = True
            self.transport.write_eof()
            self._close_when_both_ended()

    def end(self) -> None:
        """Its node sends nothing more."""
        if not self.has_ended:
            self.has_ended = True
            self.sender.put(_NOTHING)
            self._connection.transmit(self)
        self._close_when_both_ended()

    def _close_when_both_ended(self) -> None:
        if self.has_ended and self._is_shut and self.transport is not None:
            self.transport.close()


class RelayedConnection:
    """Both ends of a connection; what one sends arrives at the other as the radio carries it."""

    def __init__(
        self,
        number: int,
        nodes: tuple[int, int],
        *,
        connect: Callable[["RelayedConnection"], None],
        send: Send,
        on_end: Callable[[], object],
    ) -> None:
        """`nodes`: the one that opens it, and its target; `connect`: opens the end at the target."""
        self._number = number
        self._connect = connect
        self._send = send
        self._on_end = on_end
        self._timer: asyncio.TimerHandle | None = None
        self._ended = False
        self.opener, self.target = ConnectionEnd(self, nodes[0]), ConnectionEnd(self, nodes[1])
        for end in (self.opener, self.target):
            end.sender.put(_NOTHING)

    def on_made(self, end: ConnectionEnd) -> None:
        """The socket of an end is connected: what it sends is on its way from now on."""
        self.transmit(end)

    def on_lost(self) -> None:
        """The socket of an end is closed."""
        if self.opener.is_lost and (self.target.is_lost or self.target.receiver.missing == 0):
            self._finish()

    def refuse(self) -> None:
        """The target takes no connection."""
        self.target.is_lost = True
        self.target.end()
        if self.opener.is_lost:
            self._finish()

    def abort(self) -> None:
        """Closes both ends at once."""
        for end in (self.opener, self.target):
            if end.transport is not None:
                end.transport.abort()
        self._finish()

    def hold(self, end: ConnectionEnd, *, held: bool) -> None:
        """A node reads slower than the other one sends, or as fast again."""
        other = self._other(end)
        other.sender.is_held = held
        self.transmit(other)

    def on_packet(self, receiver: int, packet: RelayPacket) -> None:
        """A segment or an acknowledgement has arrived at a node."""
        end = self.opener if receiver == self.opener.node else self.target
        if packet.kind is PacketKind.ACKNOWLEDGEMENT:
            end.sender.on_acknowledgement(packet.sequence, packet.selected, time.monotonic_ns())
            if not end.sender.is_full and end.transport is not None and not end.has_ended:
                end.transport.resume_reading()
        else:
            for segment in end.receiver.on_segment(Segment(packet.sequence, packet.payload)):
                self._deliver(end, segment)
            answer = RelayPacket(
                PacketKind.ACKNOWLEDGEMENT,
                receiver,
                _NOTHING,
                self._number,
                end.receiver.missing,
                packet.sequence,
            )
            if not self._ended:
                self._send(self._other(end).node, [answer])
        self.transmit(end)

    def transmit(self, end: ConnectionEnd) -> None:
        """Sends what the window of an end allows, and sets the timer."""
        if self._ended:
            return
        now_ns = time.monotonic_ns()
        segments = end.sender.take(now_ns)
        if segments:
            packets = [
                RelayPacket(PacketKind.SEGMENT, end.node, one.payload, self._number, one.sequence)
                for one in segments
            ]
            self._send(self._other(end).node, packets)
        due_ns = min(
            (due for one in (self.opener, self.target) if (due := one.sender.deadline_ns()) is not None),
            default=None,
        )
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if due_ns is not None:
            # the loop's clock is CLOCK_MONOTONIC
            self._timer = asyncio.get_running_loop().call_at(due_ns / 1e9, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        now_ns = time.monotonic_ns()
        for end in (self.opener, self.target):
            end.sender.on_timer(now_ns)
            self.transmit(end)

    def _deliver(self, end: ConnectionEnd, segment: Segment) -> None:
        if segment.sequence > 0:
            end.give(segment.payload)
        elif end is self.target:
            self._connect(self)

    def _other(self, end: ConnectionEnd) -> ConnectionEnd:
        return self.target if end is self.opener else self.opener

    def _finish(self) -> None:
        self._ended = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._on_end()
