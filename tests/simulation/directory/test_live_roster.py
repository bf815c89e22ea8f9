"""The roster in swarms of 100 brokers in virtual time: a revocation reaches them, a rotation cuts no link.

Each seed is a random geometric graph of radios (mean degree 12, delivery 98 % inside 0.7 R, falling to
nothing at 1.15 R), with the daemon's cores, beacons encoded as on the wire, real signatures and sealed group
keys. A connection needs 20 to 60 ms for its handshake and a message, and one in twenty 0.4 s more for a
retransmission.
"""

import math
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from tests.simulation.directory.brokers import BrokerNode
from tests.simulation.directory.radios import RadioSwarm
from tests.simulation.directory.swarm import PLAN, SECOND, write_pose
from tests.simulation.seeds import cases, seeds

from swarmd.broker.config import Config
from swarmd.broker.core.membership.roster import roster_update
from swarmd.broker.core.membership.roster.roster_exchange import SendRoster
from swarmd.broker.core.membership.roster.roster_update import RosterUpdate
from swarmd.broker.core.swarm.links.link import LinkState
from swarmware.model.names import hardware_id
from swarmware.testing.virtual import VirtualClock
from swarmware.transport.security.keys import GROUP_KEY, Keys, read_group_key
from swarmware.transport.security.root import Root, candidate

NODES: Final = 100
FEW: Final = 30
"""Nodes where the size of the swarm does not matter."""
DEGREE: Final = 12.0
DELAY_S: Final = (0.001, 0.02)
CONNECTION_S: Final = (0.02, 0.06)
RETRANSMITTED: Final = 0.05
RETRANSMISSION_S: Final = 0.4
SETTLED_S: Final = 5.0
GOAL_S: Final = 3.0
SEEDS: Final = seeds(1, 20)


class RosterSwarm(RadioSwarm):
    """Brokers with keys, whose messages about the roster cross links that can carry a connection."""

    def __init__(
        self,
        seed: int,
        folder: Path,
        *,
        count: int = NODES,
        busy: bool = False,
        dense: bool = False,
    ) -> None:
        super().__init__(seed, count, 10_000.0 if dense else DEGREE, delay_s=DELAY_S)
        self.root = Root.make(folder, "sim")
        keys_of = {name: hardware_id(name).to_bytes(4, "little") * 8 for name in self.names}
        signed = self.root.admit(
            *(
                candidate(name, "node", seed_of_node, self.root.public)
                for name, seed_of_node in keys_of.items()
            )
        )
        group = read_group_key(folder / GROUP_KEY)
        self.carried = dict.fromkeys(self.names, 0)
        """Bytes of updates that a node sent."""
        self.updates = 0
        self.away = set[str]()
        """Nodes out of reach of all others."""
        self.brokers: dict[str, BrokerNode] = {}
        for name, seed_of_node in keys_of.items():
            keys = Keys(
                name, seed_of_node, self.root.roster, group, root_public=self.root.public, signed=signed
            )
            self.at(self.random.randrange(SECOND // 10), partial(self.start, name, keys, busy))

    def start(self, name: str, keys: Keys, busy: bool) -> None:
        config = Config(relay_bytes_s=0.0)
        node = self.brokers[name] = BrokerNode(
            self,
            name,
            VirtualClock(self),
            config=config,
            session=1 + self.random.randrange(1 << 40),
            write_boards=write_pose if busy else lambda *_: None,
            keys=keys,
            signing=keys,
            on_roster=self.connect,
        )
        if busy:
            node.driver.feed(node.core.on_plan(PLAN, self.now_ns))

    def connect(self, node: BrokerNode, message: SendRoster) -> None:
        """Carries a message over TCP, if the radios reach each other well enough."""
        sender, receiver = self.names.index(node.name), self.names.index(message.platform)
        if self.delivery[sender, receiver] < 0.2 or {node.name, message.platform} & self.away:
            return
        if isinstance(roster_update.decode(message.payload), RosterUpdate):
            self.updates += 1
            self.carried[node.name] += len(message.payload)
        delay_s = self.random.uniform(*CONNECTION_S)
        if self.random.random() < RETRANSMITTED:
            delay_s += RETRANSMISSION_S
        target = self.brokers[message.platform]
        self.after(delay_s, lambda: target.take_roster(node.name, message.payload))

    def multicast(self, sender: str, data: bytes) -> None:
        """Sends a datagram to all in range, if the sender is not away."""
        if sender not in self.away:
            super().multicast(sender, data)

    def connected_to(self, name: str, without: str) -> list[str]:
        """The nodes that good links connect with this one, not over the other one."""
        good = self.delivery > 0.7
        out = self.names.index(without)
        good[out, :] = good[:, out] = False
        reached = np.zeros(len(self.names), dtype=bool)
        reached[self.names.index(name)] = True
        for _ in self.names:
            reached |= (good & reached[:, None]).any(axis=0)
        return [name for name, is_reached in zip(self.names, reached, strict=True) if is_reached]

    def version(self, name: str) -> int:
        exchange = self.brokers[name].core.exchange
        assert exchange is not None
        return exchange.version

    def time_to(self, version: int, share: float, names: list[str]) -> float:
        """Seconds from now until this share of the nodes has a roster of this version."""
        start_ns, goal = self.now_ns, math.ceil(share * len(names))
        while sum(self.version(name) >= version for name in names) < goal:
            self.run_for(0.01)
            assert self.now_ns - start_ns < 30 * SECOND, "it does not arrive"
        return (self.now_ns - start_ns) / SECOND


@pytest.mark.parametrize("seed", SEEDS)
def test_revocation_reaches_99_nodes_within_three_seconds(seed: int, tmp_path: Path) -> None:
    swarm = RosterSwarm(seed, tmp_path, busy=seed % 2 == 1)
    swarm.run_for(SETTLED_S)
    revoked, *others = swarm.random.sample(swarm.names, 10)
    first = max(others, key=lambda name: len(swarm.connected_to(name, revoked)))
    names = swarm.connected_to(first, revoked)
    assert len(names) > 0.8 * NODES, "the graph fell apart"
    in_range = swarm.delivery[swarm.names.index(revoked)]
    near = [name for name in names if in_range[swarm.names.index(name)] > 0.2]
    swarm.brokers[first].hand_over(swarm.root.revoke(revoked))
    took_s = swarm.time_to(2, 0.99, names)
    print(f"seed {seed}: {took_s:.2f} s to 99 % of {len(names)} nodes, {swarm.updates} updates")
    assert took_s <= GOAL_S
    swarm.run_for(2.0)
    assert swarm.updates <= 1.5 * NODES, "each node got it about once"
    hw = hardware_id(revoked)
    for name in near:
        core = swarm.brokers[name].core
        assert core.exchange is not None
        if swarm.version(name) == 2:
            assert core.exchange.excludes(hw)
            assert core.nodes.get(hw) is None
            assert hw not in {route.hw for route in core._protocol.topology.routing.routes()}
            assert core.counters.refused.revoked > 0


@pytest.mark.parametrize("seed", SEEDS[:1])
def test_a_rotation_takes_no_link_down(seed: int, tmp_path: Path) -> None:
    swarm = RosterSwarm(seed, tmp_path, count=FEW)
    swarm.run_for(SETTLED_S + 3.0)
    first = swarm.names[0]
    names = swarm.connected_to(first, first)  # the best links only
    good = {
        (name, hardware_id(other))
        for index, name in enumerate(swarm.names)
        for number, other in enumerate(swarm.names)
        if swarm.delivery[index, number] > 0.95
    }
    before = {name: len(swarm.brokers[name].links) for name in swarm.names}
    for _ in range(2):
        swarm.brokers[first].hand_over(swarm.root.rotate())
        swarm.run_for(4.0)
    swarm.run_for(7.0)
    lost = [
        (name, change.hw)
        for name in swarm.names
        for change in swarm.brokers[name].links[before[name] :]
        if change.before is LinkState.UP and (name, change.hw) in good
    ]
    assert lost == []
    assert names
    for name in swarm.names:
        exchange = swarm.brokers[name].core.exchange
        assert exchange is not None
        assert exchange.version == 3 or not (swarm.delivery[swarm.names.index(name)] > 0.5).any()
        assert not exchange.epochs.is_switching


@pytest.mark.parametrize("count", cases([24], [40]))
def test_dense_cell_node_gets_roster_about_once(count: int, tmp_path: Path) -> None:
    swarm = RosterSwarm(1, tmp_path, count=count, dense=True)
    swarm.run_for(12.0)
    first = swarm.names[0]
    swarm.brokers[first].hand_over(swarm.root.rotate())
    took_s = swarm.time_to(2, 0.99, swarm.names)
    print(f"dense cell: {took_s:.2f} s, {swarm.updates} updates, {swarm.carried[first]} bytes from the first")
    assert took_s <= GOAL_S
    swarm.run_for(5.0)
    assert swarm.updates <= 1.2 * count


@pytest.mark.parametrize("seed", SEEDS[:1])
def test_node_that_was_away_during_rotations_catches_up(seed: int, tmp_path: Path) -> None:
    swarm = RosterSwarm(seed, tmp_path, count=FEW)
    swarm.run_for(SETTLED_S)
    first = swarm.names[0]
    late = next(
        name
        for name in swarm.connected_to(first, first)[::-1] + swarm.names[::-1]
        if name != first and (swarm.delivery[swarm.names.index(name)] > 0.9).any()
    )
    swarm.leave(late)
    swarm.away.add(late)
    for _ in range(3):
        swarm.brokers[first].hand_over(swarm.root.rotate())
        swarm.run_for(4.0)
    node = swarm.brokers[late]
    swarm.join(late, node.receive)
    swarm.away.clear()
    assert swarm.version(late) == 1
    took_s = swarm.time_to(4, 1.0, [late])
    print(f"caught up after {took_s:.2f} s")
    swarm.run_for(3.0)
    assert LinkState.UP in node.link_states.values()
