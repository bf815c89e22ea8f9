"""Functions over relays: renewed while there is a route, replaced by measured functions, removed with the
route."""

from itertools import pairwise
from random import Random

import pytest
from tests.simulation.timesync.clocks import Node, lan, whole_us

from swarmd.timesync.core.peer import Exchange
from swarmd.timesync.core.time_core import PeerExchange, Publish
from swarmware.types.time import Conversion

ASK_S = 10.0
"""As the service does it."""
TICK_S = 0.2


class Chain:
    """Nodes in a row, which receive their neighbours, and request functions on routes every ten seconds."""

    def __init__(self, seed: int, length: int) -> None:
        self.random = Random(seed)
        self.nodes = [Node(f"n{index}", index, self.random) for index in range(1, length + 1)]
        self.links = {frozenset(pair) for pair in pairwise(range(1, length + 1))}
        self.true_s = 0.0
        self._newest: dict[tuple[int, int], tuple[int, int]] = {}

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            tick = round(self.true_s / TICK_S)
            for link in self.links:
                a, b = (self.nodes[number - 1] for number in link)
                self._hear(a, b)
                self._hear(b, a)
            for node in self.nodes:
                now_ns = node.quartz.read_ns(self.true_s + 0.05)
                if tick % round(ASK_S / TICK_S) == node.hardware:
                    for partner in self._on_the_way(node):
                        node.core.on_functions(partner.core.functions(self._clock(partner)), now_ns)
                due_ns = node.core.deadline_ns()
                if due_ns is not None and due_ns <= now_ns:
                    for action in node.core.on_timer(now_ns):
                        if isinstance(action, Publish):
                            node.board = action.functions
                node.quartz.wander_to(self.true_s)
            self.true_s += TICK_S

    def _clock(self, node: Node) -> int:
        return node.quartz.read_ns(self.true_s + 0.05)

    def _hear(self, a: Node, b: Node) -> None:
        """One packet from b to a, with the echo of the newest that b has of a."""
        sent_ns = whole_us(b.quartz.read_ns(self.true_s))
        received_ns = whole_us(a.quartz.read_ns(self.true_s + lan(self.random, False)))
        echo = self._newest.get((b.hardware, a.hardware))
        self._newest[a.hardware, b.hardware] = (sent_ns, received_ns)
        exchange = Exchange(
            received_ns, sent_ns - received_ns, echo[0] if echo else 0, echo[1] - echo[0] if echo else None
        )
        a.core.on_exchange(PeerExchange(b.name, "main", b.hardware, 1, exchange), received_ns)

    def _reached(self, start: int, without: int) -> set[int]:
        reached, edge = {start}, [start]
        while edge:
            at = edge.pop()
            for link in self.links:
                if at in link:
                    (other,) = link - {at}
                    if other not in reached and other != without:
                        reached.add(other)
                        edge.append(other)
        return reached

    def _on_the_way(self, node: Node) -> list[Node]:
        """Neighbours over which a node is reached that is no neighbour itself."""
        own = {number for link in self.links if node.hardware in link for number in link}
        return [
            self.nodes[number - 1]
            for number in sorted(own - {node.hardware})
            if self._reached(number, node.hardware) - own
        ]

    def function(self, of: int) -> Conversion | None:
        """The function of node `of` that the first node has published."""
        return self.nodes[0].board.of(f"n{of}")

    def inside(self, of: int) -> bool:
        """Whether the first node's function of it is true within its bound."""
        function = self.function(of)
        assert function is not None
        now_ns = self.nodes[0].quartz.read_ns(self.true_s)
        error_ns = abs(function.to_remote(now_ns) - self.nodes[of - 1].quartz.read_ns(self.true_s))
        return error_ns <= function.bound_at_ns(now_ns)


@pytest.mark.parametrize("step_s", [5.0, -0.02])
def test_relayed_function_follows_clock_step_at_its_end(step_s: float) -> None:
    for seed in range(2):
        chain = Chain(seed, 5)
        chain.run(70)
        before = chain.function(5)
        assert before is not None
        assert (before.hops, before.via) == (4, "n2")
        assert chain.inside(5)
        chain.nodes[-1].quartz.step(step_s)
        chain.run(3 * ASK_S + 5)
        after = chain.function(5)
        assert after is not None
        assert after.conv_epoch != before.conv_epoch
        assert chain.inside(5), f"seed {seed}"


def test_relayed_function_is_renewed_while_route_exists() -> None:
    chain = Chain(3, 4)
    chain.run(60)
    for _ in range(4):
        chain.run(30)
        function = chain.function(4)
        assert function is not None
        assert function.age_s(chain.nodes[0].quartz.read_ns(chain.true_s)) < 3 * (ASK_S + 5)
        assert chain.inside(4)


def test_measured_function_replaces_composed_one_until_lost() -> None:
    chain = Chain(4, 4)
    chain.run(50)
    chain.links.add(frozenset((1, 4)))
    chain.run(3)
    measured = chain.function(4)
    assert measured is not None
    assert (measured.hops, measured.via) == (1, "")
    chain.links.remove(frozenset((1, 4)))
    chain.nodes[-1].quartz.step(0.02)  # the measurement is no longer true, and only the others see it
    chain.run(4 * ASK_S)
    composed = chain.function(4)
    assert composed is not None
    assert composed.hops == 3
    assert chain.inside(4)


def test_function_over_relays_ends_when_way_is_gone() -> None:
    chain = Chain(5, 5)
    chain.run(60)
    assert chain.function(5) is not None
    chain.links.remove(frozenset((3, 4)))  # in the middle: n3 keeps what it measured of n4
    chain.run(150)
    assert chain.function(5) is None
    assert chain.function(4) is None
    third = chain.function(3)
    assert third is not None
    assert third.hops == 2


def test_composed_functions_end_with_last_neighbour() -> None:
    chain = Chain(6, 3)
    chain.run(40)
    assert chain.function(3) is not None
    chain.links.clear()
    chain.run(65)
    assert chain.function(3) is None
    assert chain.function(2) is not None  # measured: kept, its bound grows
