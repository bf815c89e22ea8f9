"""A radio core in virtual time: nodes, frames between them, and what arrives when."""

import random
from collections.abc import Callable, Sequence

from swarmlab.radio.core.model import RadioModel, TracePoint
from swarmlab.radio.core.network import LinkReport, RadioCore, RadioDelivery, RadioNode
from swarmlab.radio.process import ethernet_address

MS = 1_000_000
SECOND = 1000 * MS
BROADCAST = b"\xff" * 6

PLAIN = RadioModel(description="no limit", multicast_rate_bit_s=1e9)
"""A kilobyte takes 8 microseconds."""


def frame(receiver: int | None, size: int = 1000, text: bytes = b"") -> bytes:
    """An Ethernet frame to a node, or to all nodes if `receiver` is None."""
    address = BROADCAST if receiver is None else ethernet_address(receiver)
    return (address + bytes(6) + b"\x08\x00" + text).ljust(size, b"\0")


class RadioRig:
    """A network of nodes without devices."""

    def __init__(
        self,
        model: RadioModel = PLAIN,
        names: Sequence[str] = ("gcs", "ugv1", "uav1"),
        chance: Callable[[], float] | None = None,
        trace: tuple[TracePoint, ...] = (),
    ) -> None:
        self.names = list(names)
        nodes = [
            RadioNode(name, name.partition(".")[0], name.startswith("uav"), ethernet_address(index))
            for index, name in enumerate(names)
        ]
        self.core = RadioCore(model, trace, nodes, chance or random.Random(7).random, 0)
        self.arrived: list[tuple[int, RadioDelivery]] = []
        """Instant and frame of each arrival."""

    def index(self, name: str) -> int:
        return self.names.index(name)

    def send(
        self, sender: str, receiver: str | None, at_ns: int, size: int = 1000, text: bytes = b""
    ) -> None:
        """Sends a frame, after all that is due before it has happened."""
        self.until(at_ns)
        data = frame(None if receiver is None else self.index(receiver), size, text)
        self._take(at_ns, self.core.on_frame(self.index(sender), data, at_ns))

    def until(self, end_ns: int) -> None:
        """Calls the core at each of its deadlines up to an instant."""
        while (due_ns := self.core.deadline_ns()) is not None and due_ns <= end_ns:
            self._take(due_ns, self.core.on_timer(due_ns))

    def place(self, at_ns: int = 0, **positions: tuple[float, float, float]) -> None:
        self.core.on_positions({self.index(name): where for name, where in positions.items()}, at_ns)

    def report(self, sender: str, receiver: str, now_ns: int = 0) -> LinkReport:
        return self.core.report(self.index(sender), self.index(receiver), now_ns)

    def link(self, sender: str, receiver: str) -> tuple[int, int]:
        return self.index(sender), self.index(receiver)

    def receivers(self) -> list[str]:
        return [self.names[delivery.receiver] for _, delivery in self.arrived]

    def _take(self, at_ns: int, deliveries: list[RadioDelivery]) -> None:
        self.arrived += [(at_ns, delivery) for delivery in deliveries]
