"""Trees of moving swarms converge, no subscription is lost: real cores, virtual time, many seeds.

Messages get lost, their acknowledgements get lost, some arrive when they were given up; nodes drive apart
and meet again, crash, come back; tree services and modules come and go. When the radios stand still, every
node must know the structure of its neighbours and of those it reads, have their newest values, and be told
the next ones, each event once and in order.
"""

import pytest
from tests.simulation.seeds import cases, seeds
from tests.simulation.tree.swarm import Swarm, Weather

SEEDS = seeds(3, 120)
HEALED_S = 9.0
"""A request that was lost twice is repeated after 4 s, and that one may be lost, too."""
FIELDS_M = (2200.0, 2700.0, 3300.0)
"""One net of mean degree 8; a net that falls apart and meets again; islands."""


def story(seed: int, weather: Weather) -> list[str]:
    """Runs one swarm; what was wrong in the end."""
    swarm = Swarm(seed, weather)
    swarm.run()
    if before := swarm.wrong(events=False):
        # a renewal may be on its way at this very instant: what is wrong must heal by itself, and soon
        swarm.run_for(HEALED_S)
        before = swarm.wrong(events=False)
    swarm.roll_call()
    return before + swarm.wrong(events=True) + swarm.events_wrong()


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_trees_of_hundred_moving_nodes_converge(seed: int) -> None:
    wrong = story(seed, Weather(field_m=FIELDS_M[seed % len(FIELDS_M)]))
    assert not wrong, wrong[:5]


@pytest.mark.parametrize("seed", seeds(2, 6))
def test_every_node_follows_whole_swarm_on_request(seed: int) -> None:
    wrong = story(seed, Weather(nodes=25, field_m=2700.0, whole_swarm=True))
    assert not wrong, wrong[:5]


@pytest.mark.parametrize("seed", cases([24, 68], [55, 115, 123, 195]))
def test_late_notification_of_former_start_changes_nothing(seed: int) -> None:
    """Found by these seeds: the late one was taken for a new start, and all of the real one refused."""
    wrong = story(seed, Weather(field_m=FIELDS_M[seed % len(FIELDS_M)], late=0.1, tree_restarts=20))
    assert not wrong, wrong[:5]


def test_the_same_seed_tells_the_same_story() -> None:
    first, second = (Swarm(3, Weather(nodes=12)) for _ in range(2))
    first.run()
    second.run()
    assert first.messages == second.messages
    assert [node.mirrors for node in first.nodes.values()] == [node.mirrors for node in second.nodes.values()]
