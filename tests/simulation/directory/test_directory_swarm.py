"""Brokers of moving swarms in virtual time: no loop ever, routes that come back.

Each seed is a swarm of 100 brokers: a random geometric graph of radios (300 m, mean degree 9, delivery
98 % inside 0.7 R, falling to nothing at 1.15 R), beacons at 10 Hz, encoded and decoded as on the wire, the
daemon's own timeouts. All start at once; as soon as there are routes they move at 20 m/s while 12 of them
crash, some for good, some back after 50 ms to 1 s (also within the link timeout, also with another clock).
Datagrams are delayed by up to 60 ms, so they cross every change of state. Each changed route is followed
at the instant of its change: a loop fails the seed.
When the churn is over, 99 % of the pairs that good links connect must have a working route within six
seconds.
"""

from collections.abc import Iterator
from typing import Final

import pytest
from tests.simulation.directory.swarm import SECOND, Swarm
from tests.simulation.seeds import seeds

from swarmd.broker.core.beacon.declared_period import RestartState

CHURN_S: Final = (0.5, 1.25)
"""Virtual time in which nodes move and crash; the last ones start again a second later."""
SETTLED_S: Final = 8.0
"""By then the routes must be back."""
SEEDS: Final = seeds(1, 40)
NODES: Final = 100


def lifetimes(swarm: Swarm) -> Iterator[tuple[int, str, str]]:
    """When which node crashes and starts again."""
    for name in swarm.random.sample(swarm.names, NODES // 8):
        down_ns = int(swarm.random.uniform(*CHURN_S) * SECOND)
        yield down_ns, name, "crash"
        if swarm.random.random() < 0.7:
            away_s = swarm.random.choice((0.05, 0.2, 0.5, 1.0))
            yield down_ns + int(away_s * SECOND), name, swarm.random.choice(("start", "start late"))


@pytest.mark.parametrize("seed", SEEDS)
def test_moving_swarms_of_100_brokers_never_loop(seed: int) -> None:
    swarm = Swarm(seed, NODES, speed_m_s=20.0)
    step_ns = SECOND // 4
    life, former = sorted(lifetimes(swarm)), dict[str, RestartState]()
    connected = arrived = 0
    for at_ns in range(step_ns, int(SETTLED_S * SECOND) + 1, step_ns):
        while life and life[0][0] <= at_ns:
            when_ns, name, what = life.pop(0)
            swarm.run_until(when_ns)
            if what == "crash":
                former[name] = swarm.crash(name)
            else:
                swarm.start(name, late=what == "start late", former=former[name])
        swarm.run_until(at_ns)
        if at_ns <= CHURN_S[1] * SECOND:
            swarm.move(step_ns / SECOND)
        elif not life:
            followed = swarm.follow(0.02)
            connected, arrived = int(followed.connected.sum()), int(followed.arrived.sum())
            assert connected > NODES, f"the graph fell apart: {connected} pairs"
            if arrived >= 0.99 * connected:
                swarm.assert_published()
                return
    pytest.fail(f"{arrived} of {connected} connected pairs have a route that works")
