"""The radio network: frames of its nodes in, frames for its nodes out, at their instants."""

import heapq
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import msgspec

from swarmlab.radio.core.link import Chance, DirectedLink, DropReason, Impairment, ImpairmentChange
from swarmlab.radio.core.medium import Medium, WaitingFrame
from swarmlab.radio.core.model import Propagation, RadioModel, RadioQuality, TracePoint

Position = tuple[float, float, float]
"""x, y, z in metres."""

ADDRESS_BYTES: Final = 6
_GROUP_BIT: Final = 0x01
"""Of the first byte of an Ethernet address: multicast or broadcast."""


class RadioNode(msgspec.Struct, frozen=True):
    """One node of the network."""

    name: str
    """Name of the node: the platform, with the computer of a vehicle that has several."""
    platform: str
    """Computers of one platform have a wire between them, besides their radios."""
    flies: bool
    address: bytes
    """Ethernet address."""


class RadioDelivery(msgspec.Struct, frozen=True, gc=False):
    """Action: write this frame to the device of its receiver."""

    receiver: int
    data: bytes


class LinkReport(msgspec.Struct, frozen=True):
    """Present state of one direction of a link, and what it carried since the start."""

    sender: str
    receiver: str
    state: str
    """up | cut | out of range."""
    distance_m: float
    rate_bit_s: float
    """Rate of unicast frames by distance in bit/s, or 0 for a wire."""
    radio_loss_ratio: float
    """Loss of one transmission by distance."""
    impairment: Impairment
    frames: int
    """Frames that arrived."""
    bytes: int
    lost: int
    """Frames lost by the radio, by an impairment, or out of range."""
    dropped: int
    """Frames that found a full queue."""
    cut: int
    """Frames that were sent while the link was cut."""
    queued_bytes: int
    """Bytes in the sender's transmit queue, for all receivers, and on the way to this one."""
    delay_s: float
    """Mean time of the last frames from the sender's device to the receiver's."""


class RadioCore:
    """Decides which frame arrives where and when; every instant is on one clock."""

    def __init__(
        self,
        model: RadioModel,
        trace: tuple[TracePoint, ...],
        nodes: Sequence[RadioNode],
        chance: Chance,
        start_ns: int,
    ) -> None:
        self._model = model
        self._propagation = Propagation(model, trace)
        self._nodes = nodes
        self._by_address = {node.address: index for index, node in enumerate(nodes)}
        self._chance = chance
        self._start_ns = start_ns
        self._positions: list[Position] = [model.station_m] * len(nodes)
        self._qualities: dict[int, list[RadioQuality]] = {}
        """Quality to each receiver, by sender, at the present positions."""
        self._medium = Medium(len(nodes), model.queue_bytes)
        every = range(len(nodes))
        self._links = [[DirectedLink(chance) for _ in every] for _ in every]
        self._wired = [
            [other for other in every if other != one and nodes[other].platform == nodes[one].platform]
            for one in every
        ]
        self._due: list[tuple[int, int, int, WaitingFrame]] = []
        """Frames on the way: arrival, order, receiver, frame."""
        self._order = 0

    def deadline_ns(self) -> int | None:
        """Instant of the next arrival or transmission, or None without a frame on its way."""
        start_ns = self._medium.next_start_ns()
        if not self._due:
            return start_ns
        due_ns = self._due[0][0]
        return due_ns if start_ns is None else min(due_ns, start_ns)

    def on_timer(self, now_ns: int) -> list[RadioDelivery]:
        """Transmissions start and frames arrive."""
        while (started := self._medium.take(now_ns)) is not None:
            self._transmit(*started)
        found = []
        while self._due and self._due[0][0] <= now_ns:
            due_ns, _, receiver, frame = heapq.heappop(self._due)
            link = self._links[frame.sender][receiver]
            if link.arrive(len(frame.data), (due_ns - frame.since_ns) / 1e9):
                found.append(RadioDelivery(receiver, frame.data))
        return found

    def on_frame(self, sender: int, data: bytes, now_ns: int) -> list[RadioDelivery]:
        """A node sends an Ethernet frame."""
        frame = WaitingFrame(sender, data, now_ns)
        receivers = self._receivers(sender, data)
        wired = self._wired[sender]
        for receiver in receivers:
            # a wire has no airtime, queue or loss by distance
            if receiver in wired:
                self._arrive(receiver, frame, now_ns)
        radio = [receiver for receiver in receivers if receiver not in wired]
        if radio and not self._medium.add(frame):
            for receiver in radio:
                self._links[sender][receiver].drop(DropReason.QUEUE)
        return self.on_timer(now_ns)

    def on_positions(self, positions: Mapping[int, Position], now_ns: int) -> list[RadioDelivery]:
        """Nodes have moved; those that are not named have not."""
        for node, position in positions.items():
            self._positions[node] = position
        # a move changes the quality of all links of a node, in both directions
        self._qualities.clear()
        return self.on_timer(now_ns)

    def on_impairment(
        self, links: Iterable[tuple[int, int]], change: ImpairmentChange, now_ns: int
    ) -> list[RadioDelivery]:
        """An operator impairs these directions."""
        for sender, receiver in links:
            link = self._links[sender][receiver]
            link.impairment = change.applied(link.impairment)
        return self.on_timer(now_ns)

    def on_cut(self, links: Iterable[tuple[int, int]], now_ns: int) -> list[RadioDelivery]:
        """An operator cuts these directions."""
        for sender, receiver in links:
            self._links[sender][receiver].is_cut = True
        return self.on_timer(now_ns)

    def on_heal(self, links: Iterable[tuple[int, int]], now_ns: int) -> list[RadioDelivery]:
        """An operator removes cuts and impairments of these directions."""
        for sender, receiver in links:
            link = self._links[sender][receiver]
            link.is_cut, link.impairment = False, Impairment()
        return self.on_timer(now_ns)

    def report(self, sender: int, receiver: int, now_ns: int) -> LinkReport:
        """State and counters of one direction."""
        link, nodes = self._links[sender][receiver], self._nodes
        quality = self._quality(sender, now_ns)[receiver]
        is_wired = receiver in self._wired[sender]
        in_range = is_wired or quality.in_range
        return LinkReport(
            sender=nodes[sender].name,
            receiver=nodes[receiver].name,
            state="cut" if link.is_cut else "up" if in_range else "out of range",
            distance_m=quality.distance_m,
            rate_bit_s=0.0 if is_wired else quality.rate_bit_s,
            radio_loss_ratio=0.0 if is_wired else quality.loss_ratio,
            impairment=link.impairment,
            frames=link.frames,
            bytes=link.bytes,
            lost=link.dropped[DropReason.LOST] + link.dropped[DropReason.OUT_OF_RANGE],
            dropped=link.dropped[DropReason.QUEUE],
            cut=link.dropped[DropReason.CUT],
            queued_bytes=self._medium.queued_bytes(sender) + link.in_flight_bytes,
            delay_s=link.mean_delay_s,
        )

    def _receivers(self, sender: int, data: bytes) -> Iterable[int]:
        """Nodes to which a frame is addressed; none for an unknown address."""
        if data and data[0] & _GROUP_BIT:
            return [node for node in range(len(self._nodes)) if node != sender]
        receiver = self._by_address.get(data[:ADDRESS_BYTES])
        return () if receiver is None or receiver == sender else (receiver,)

    def _transmit(self, frame: WaitingFrame, start_ns: int) -> None:
        sender, model = frame.sender, self._model
        row = self._quality(sender, start_ns)
        wired = self._wired[sender]
        receivers = [node for node in self._receivers(sender, frame.data) if node not in wired]
        if frame.data[0] & _GROUP_BIT:
            # sent once at the basic rate, and lost by each receiver on its own: nothing acknowledges it
            end_ns = start_ns + self._airtime_ns(frame, model.multicast_rate_bit_s)
            arrived = [node for node in receivers if self._transmissions(sender, node, row[node], 1)]
        else:
            (receiver,) = receivers
            limit = model.retries + 1
            made = self._transmissions(sender, receiver, row[receiver], limit)
            # a lost frame occupies the air for all its repetitions
            end_ns = start_ns + (made or limit) * self._airtime_ns(frame, row[receiver].rate_bit_s)
            arrived = receivers if made else []
        near = [node for node, quality in enumerate(row) if quality.in_range] if model.shared_air else []
        self._medium.occupy({sender, *near}, end_ns)
        # one draw for all receivers of a transmission: they wait for the same contention
        delay_s = model.delay_s + (model.jitter_s * self._chance() if model.jitter_s else 0.0)
        at_ns = end_ns + round(delay_s * 1e9)
        for node in arrived:
            self._arrive(node, frame, at_ns)

    def _transmissions(self, sender: int, receiver: int, quality: RadioQuality, limit: int) -> int:
        """Transmissions until the frame is received, or 0 for a lost frame, which is counted."""
        for made in range(1, limit + 1):
            if self._chance() >= quality.loss_ratio:
                return made
        self._links[sender][receiver].drop(DropReason.LOST if quality.in_range else DropReason.OUT_OF_RANGE)
        return 0

    def _airtime_ns(self, frame: WaitingFrame, rate_bit_s: float) -> int:
        return round((self._model.overhead_s + len(frame.data) * 8 / rate_bit_s) * 1e9)

    def _arrive(self, receiver: int, frame: WaitingFrame, at_ns: int) -> None:
        arrival_ns = self._links[frame.sender][receiver].arrival_ns(len(frame.data), at_ns)
        if arrival_ns is not None:
            # frames that arrive at the same instant stay in their order, and the heap never compares frames
            self._order += 1
            heapq.heappush(self._due, (arrival_ns, self._order, receiver, frame))

    def _quality(self, sender: int, now_ns: int) -> list[RadioQuality]:
        # kept until a node moves, since each frame asks for it
        row = self._qualities.get(sender)
        if row is None:
            here, elapsed_s = self._positions[sender], (now_ns - self._start_ns) / 1e9
            row = self._qualities[sender] = [
                self._propagation.quality(
                    math.dist(here, there),
                    elapsed_s,
                    flies=self._nodes[sender].flies or self._nodes[node].flies,
                )
                for node, there in enumerate(self._positions)
            ]
        return row
