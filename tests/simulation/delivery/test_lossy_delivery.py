"""Two nodes in virtual time, a network that loses and reorders: exactly once, or the sender learns it."""

from collections import Counter
from functools import partial

import pytest

from swarmware.model.frame import Frame, FrameKind, decode, encode
from swarmware.testing.virtual import VirtualSwarm
from swarmware.transport.delivery.answer import expired_here, reply, with_lifetime
from swarmware.transport.delivery.duplicates import DuplicateFilter, DuplicateState
from swarmware.transport.delivery.outbox import Complete, Outbox, Transmit
from swarmware.transport.delivery.outcome import Status
from swarmware.types import registry
from swarmware.types.rpc import Ack
from swarmware.types.time import Conversion

SENDER, RECEIVER = 1, 2
APP, DATA = 5, 6


class Receiving:
    """The receiving end as the message router does it: an inbox with room for some, emptied by its reader."""

    def __init__(self, net: VirtualSwarm[int], room: int, sender_clock: Conversion | None = None) -> None:
        self.net = net
        self.given: Counter[tuple[int, int]] = Counter()
        """Sender and sequence → how often."""
        self.given_ns: dict[int, int] = {}
        self._sender_clock = sender_clock
        self._room = room
        self._inbox = 0
        self.received = DuplicateFilter()
        net.join(RECEIVER, self.on_data)
        net.every(0.05, self._read)

    def _read(self) -> None:
        self._inbox = max(0, self._inbox - 4)

    def on_data(self, sender: int, data: bytes) -> None:
        frame = decode(data)
        origin = (frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence)
        seen = self.received.lookup(origin)
        if seen is None:
            if self._inbox >= self._room or expired_here(frame, self.net.now_ns, self._sender_clock):
                return
            self._inbox += 1
            self.given[sender, frame.sequence] += 1
            self.given_ns[frame.sequence] = self.net.now_ns
            seen = registry.encode(Ack(int(Status.DELIVERED)))
            self.received.answered(origin, seen, self.net.now_ns)
        if isinstance(seen, DuplicateState):
            seen = registry.encode(Ack(int(Status.DELIVERED)))  # its answer is no longer held
        self.net.send(RECEIVER, sender, encode(reply(frame, FrameKind.ACK, seen, self.net.now_ns)))


class Sending:
    """The sending end as the message router does it."""

    def __init__(self, net: VirtualSwarm[int], hardware: int = SENDER, ahead_ns: int = 0) -> None:
        """`ahead_ns`: how far the sender's clock is ahead of the receiver's."""
        self.net = net
        self.told: dict[int, Status] = {}
        self.told_ns: dict[int, int] = {}
        self.outbox = Outbox(hardware)
        self._hardware = hardware
        self._ahead_ns = ahead_ns
        self._driver = net.drive(self.outbox, self._perform)
        net.join(hardware, self.on_data)

    def submit(self, sequence: int, timeout_s: float) -> None:
        frame = Frame(
            FrameKind.MESSAGE,
            DATA,
            self._hardware,
            APP,
            RECEIVER,
            sequence=sequence,
            stamp_ns=self.net.now_ns + self._ahead_ns,
            extension=with_lifetime(timeout_s),
        )
        self._driver.feed(self.outbox.on_submit(frame, round(timeout_s * 1e9), self.net.now_ns))

    def on_data(self, sender: int, data: bytes) -> None:
        frame = decode(data)
        ack = registry.decode(Ack, frame.payload)
        key = (frame.receiver_app, frame.data_id, frame.sequence)
        self._driver.feed(self.outbox.on_ack(key, ack, self.net.now_ns))

    def _perform(self, action: Transmit | Complete) -> None:
        if isinstance(action, Transmit):
            self.net.send(self._hardware, RECEIVER, encode(action.frame))
        else:
            sequence = action.key[2]
            assert sequence not in self.told, "told twice"
            self.told[sequence] = action.outcome.status
            self.told_ns[sequence] = self.net.now_ns


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("loss", [0.0, 0.1, 0.4])
def test_each_message_arrives_once_or_sender_learns(seed: int, loss: float) -> None:
    net: VirtualSwarm[int] = VirtualSwarm(seed, loss=loss, duplicate=0.2, delay_s=(0.001, 0.4))
    receiving, sending = Receiving(net, room=8), Sending(net)
    count = 60
    for number in range(count):
        timeout_s = net.random.uniform(0.5, 20.0)
        net.after(net.random.uniform(0, 5), lambda n=number, t=timeout_s: sending.submit(n, t))  # type: ignore[misc]
    if seed % 4 == 0:  # an outage in the middle
        net.after(2.0, lambda: setattr(net, "link", lambda a, b: False))
        net.after(4.0, lambda: setattr(net, "link", lambda a, b: True))
    net.run_for(60)

    assert len(sending.told) == count, "every sender is told"
    assert max(receiving.given.values()) == 1, "nothing twice"
    delivered = {number for number, status in sending.told.items() if status is Status.DELIVERED}
    assert delivered <= {sequence for _, sequence in receiving.given}, (
        "what is called delivered was delivered"
    )
    assert len(sending.outbox) == 0
    if loss == 0.0 and seed % 4:
        assert len(delivered) >= count * 0.9


def test_a_seed_gives_the_same_run_again() -> None:
    def run() -> tuple[dict[int, Status], Counter[str]]:
        net: VirtualSwarm[int] = VirtualSwarm(7, loss=0.3, duplicate=0.1)
        Receiving(net, room=3)
        sending = Sending(net)
        for number in range(20):
            sending.submit(number, 3.0)
        net.run_for(10)
        return sending.told, net.counts

    assert run() == run()


def test_twenty_thousand_messages_are_each_delivered_once() -> None:
    net: VirtualSwarm[int] = VirtualSwarm(11, loss=0.45, duplicate=0.1, delay_s=(0.001, 0.05))
    receiving = Receiving(net, room=1_000_000)
    senders = [Sending(net, hardware=100 + number) for number in range(40)]
    count = 500
    for sending in senders:
        start = net.random.getrandbits(32)
        for number in range(count):
            sequence = (start + number) & 0xFFFF_FFFF
            submit = partial(sending.submit, sequence, 20.0)
            net.after(net.random.uniform(0, 10), submit)
    net.run_for(40)
    assert max(receiving.given.values()) == 1, "nothing twice"
    assert sum(len(sending.told) for sending in senders) == 40 * count
    assert receiving.received.spans <= 2 * len(senders)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("ahead_s", [0.0, -300.0, 86_400.0])
def test_expired_message_is_not_delivered_later(seed: int, ahead_s: float) -> None:
    net: VirtualSwarm[int] = VirtualSwarm(seed, loss=0.3, delay_s=(0.05, 0.6))
    error_ns = net.random.randint(-2_000_000, 2_000_000)
    ahead_ns = round(ahead_s * 1e9)
    clock = Conversion("uav1", "main", SENDER, 1, ahead_ns + error_ns, 0.0, 0, 2_000_000, 0, 0.0, 1)
    receiving, sending = Receiving(net, room=1000, sender_clock=clock), Sending(net, ahead_ns=ahead_ns)
    for number in range(200):
        net.after(net.random.uniform(0, 20), partial(sending.submit, number, 0.5))
    net.run_for(40)
    later = [
        number
        for number, status in sending.told.items()
        if status is Status.EXPIRED and receiving.given_ns.get(number, 0) > sending.told_ns[number]
    ]
    assert later == []
    assert len(receiving.given) > 80, "those in time are given"
