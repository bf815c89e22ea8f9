"""Brokers that start again in swarms of slow senders: no loop at any change of any route.

World and brokers come from test_directory_swarm, with a sixth of the datagrams lost in addition. Every
second or so one broker dies without a word and starts again 20 ms to 3 s later: it has forgotten what it
advertised, while others may still send through it. Slow senders are missed late: at 2 Hz (nobody subscribes)
after seconds, at 1 Hz, where the processor is short, after more. Their new session is accepted as late as
it can be: its datagrams are lost until the link to the old one is down.
"""

from pathlib import Path
from typing import Final

import pytest
from tests.simulation.directory.brokers import BrokerNode, header_of
from tests.simulation.directory.swarm import SECOND, Swarm
from tests.simulation.seeds import seeds

from swarmd.broker.core.beacon.declared_period import RestartState
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.records.session_store import SessionStore

SEEDS: Final = seeds(1, 6)
NODES: Final = 25
LOSS: Final = 1 / 6
AWAY_S: Final = (0.02, 0.2, 0.6, 1.5, 3.0)


class Restarting(Swarm):
    """A swarm in which a new session is accepted as late as it can be."""

    def __init__(self, seed: int, tick_hz: float, *, subscribed: bool) -> None:
        super().__init__(seed, NODES, speed_m_s=3.0, loss=LOSS, tick_hz=tick_hz, subscribed=subscribed)
        self.away: dict[str, tuple[int, RestartState]] = {}
        """By node: when it starts again, and what it stored."""
        self.accepted: dict[tuple[BrokerNode, int], int] = {}
        """By receiver and hardware id of the sender: the session whose datagrams arrive."""

    def _arrive(self, sender: str, receiver: str, data: bytes) -> None:
        node = self.brokers.get(receiver)
        if node is None:
            return
        header = header_of(data)
        assert header.session is not None
        key = node, header.sender_hw
        is_down = node.link_states.get(header.sender_hw, LinkState.DOWN) is LinkState.DOWN
        if is_down or self.accepted.get(key, header.session) == header.session:
            self.accepted[key] = header.session
            super()._arrive(sender, receiver, data)

    def replace_one(self, quiet_ns: int | None = None) -> None:
        """One broker dies; those whose time is over come back. `quiet_ns`: they lost what they stored."""
        for name, (back_ns, stored) in list(self.away.items()):
            if back_ns <= self.now_ns:
                del self.away[name]
                former = stored if quiet_ns is None else RestartState(quiet_ns=quiet_ns)
                self.start(name, late=self.random.random() < 0.2, former=former)
        name = self.random.choice(self.names)
        if name in self.brokers:
            back_ns = self.now_ns + int(self.random.choice(AWAY_S) * SECOND)
            self.away[name] = back_ns, self.crash(name)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("tick_hz", "subscribed", "every_s", "seconds"),
    [(10.0, True, 0.33, 6), (2.0, False, 0.5, 30), (1.0, True, 1.0, 50)],
)
def test_restarts_among_slow_senders_make_no_loop(
    tick_hz: float, subscribed: bool, every_s: float, seconds: int, seed: int
) -> None:
    swarm = Restarting(seed, tick_hz, subscribed=subscribed)
    swarm.run_for(2 / tick_hz)
    for _ in range(round(seconds / every_s)):
        swarm.run_for(every_s)
        swarm.move(every_s)
        swarm.replace_one()
    assert swarm.changes > 500


@pytest.mark.parametrize("seed", seeds(1, 3))
def test_nodes_without_former_data_make_no_loop(tmp_path: Path, seed: int) -> None:
    quiet_ns = SessionStore(tmp_path).quiet_ns(SECOND)
    swarm = Restarting(seed, 2.0, subscribed=False)
    for _ in range(60):
        swarm.run_for(0.5)
        swarm.move(0.5)
        swarm.replace_one(quiet_ns)
    assert swarm.changes > 500
