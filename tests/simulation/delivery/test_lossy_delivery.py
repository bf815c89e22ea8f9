"""Two nodes in virtual time, a network that loses and reorders: exactly once, or the sender is told."""

from collections import Counter

import pytest

from swarmware.delivery import Outbox, Received, Seen, Settle, Status, Transmit, reply
from swarmware.frame import Frame, Kind, decode, encode
from swarmware.testing import VirtualSwarm
from swarmware.types import registry
from swarmware.types.rpc import Ack

SENDER, RECEIVER = 1, 2
APP, DATA = 5, 6


class Receiving:
    """The receiving end as `post` does it: an inbox with room for some, emptied by its reader."""

    def __init__(self, net: VirtualSwarm[int], room: int) -> None:
        self.net = net
        self.given: Counter[int] = Counter()
        self._room = room
        self._inbox = 0
        self._received = Received()
        net.join(RECEIVER, self.on_data)
        net.every(0.05, self._read)

    def _read(self) -> None:
        self._inbox = max(0, self._inbox - 4)

    def on_data(self, sender: int, data: bytes) -> None:
        frame = decode(data)
        origin = (frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence)
        seen = self._received.look(origin)
        if seen is None:
            if self._inbox >= self._room:
                return
            self._inbox += 1
            self.given[frame.sequence] += 1
            seen = registry.encode(Ack(int(Status.DELIVERED)))
            self._received.answered(origin, seen, self.net.now_ns)
        assert not isinstance(seen, Seen)
        self.net.send(RECEIVER, sender, encode(reply(frame, Kind.ACK, seen, self.net.now_ns)))


class Sending:
    """The sending end as `post` does it."""

    def __init__(self, net: VirtualSwarm[int]) -> None:
        self.net = net
        self.told: dict[int, Status] = {}
        self.outbox = Outbox(SENDER)
        self._arm = net.wake(self.outbox.deadline_ns, self._on_timer)
        net.join(SENDER, self.on_data)

    def _on_timer(self, now_ns: int) -> None:
        self._do(self.outbox.on_timer(now_ns))

    def submit(self, sequence: int, timeout_s: float) -> None:
        frame = Frame(Kind.MESSAGE, DATA, SENDER, APP, RECEIVER, sequence=sequence)
        self._do(self.outbox.submit(frame, self.net.now_ns, round(timeout_s * 1e9)))
        self._arm()

    def on_data(self, sender: int, data: bytes) -> None:
        frame = decode(data)
        ack = registry.decode(Ack, frame.payload)
        self._do(
            self.outbox.on_ack((frame.receiver_app, frame.data_id, frame.sequence), ack, self.net.now_ns)
        )
        self._arm()

    def _do(self, actions: list[Transmit | Settle]) -> None:
        for action in actions:
            if isinstance(action, Transmit):
                self.net.send(SENDER, RECEIVER, encode(action.frame))
            else:
                sequence = action.key[2]
                assert sequence not in self.told, "told twice"
                self.told[sequence] = action.outcome.status


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("loss", [0.0, 0.1, 0.4])
def test_each_message_arrives_exactly_once_or_its_sender_is_told(seed: int, loss: float) -> None:
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
    assert delivered <= set(receiving.given), "what is called delivered was delivered"
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
