"""A cut link is noticed, gone around and used again in time."""

import pytest
from tests.simulation.directory.brokers import beacon_of
from tests.simulation.directory.link_loss import SETTLED_S, Triangle, middle, outages, worst
from tests.simulation.directory.storm import Storm

from swarmd.broker.core.beacon.beacon_rate import airtime_s
from swarmd.broker.core.swarm.links.link import LinkState
from swarmware.model.names import hardware_id

SEEDS = range(1, 11)
LASTS_S = 60.0
AIR = 0.25


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_cut_link_is_noticed_and_bypassed(loss: float) -> None:
    found = worst(outages(SEEDS, loss=loss))
    assert found.noticed < 1.5
    assert found.rerouted < 2.0
    assert found.data_back < 1.0
    assert found.frames_back < 1.0


def test_data_return_as_soon_on_only_link() -> None:
    found = worst(outages(SEEDS, third=False))
    assert found.data_back < 1.0
    assert found.frames_back < 1.0


@pytest.mark.parametrize("third", [True, False])
def test_idle_nodes_at_2_hz_notice_cut(third: bool) -> None:
    found = worst(outages(SEEDS, third=third, busy=False))
    assert found.noticed < 1.5
    assert found.rerouted < 2.0
    assert found.frames_back < 1.0


def test_idle_nodes_notice_cut_of_lossy_links_early() -> None:
    found = middle(outages(SEEDS, loss=0.3, busy=False))
    assert found.noticed < 3.0, "3.9 s without requests"


@pytest.mark.parametrize(("loss", "most_hz"), [(0.0, 2.05), (0.3, 2.3)])
def test_idle_nodes_rarely_request_and_keep_links(loss: float, most_hz: float) -> None:
    swarm = Triangle(1, loss=loss, busy=False)
    swarm.run_for(3 * SETTLED_S)
    nodes = swarm.brokers.values()
    for node in nodes:
        node.links.clear()
        node.sent = 0
    swarm.run_for(LASTS_S)
    assert not any(node.links for node in nodes)
    assert sum(node.sent for node in nodes) / len(nodes) / LASTS_S < most_hz


def test_nodes_state_answer_times_only_during_link_changes() -> None:
    swarm, stated = Triangle(1), set[tuple[str, bool]]()
    send = swarm.multicast

    def multicast(sender: str, data: bytes) -> None:
        if beacon_of(data).solicitation is not None:
            stated.add((sender, swarm.now_ns > SETTLED_S * 1e9))
        send(sender, data)

    swarm.multicast = multicast  # type: ignore[method-assign]  # what is in the air
    swarm.run_for(6 * SETTLED_S)
    assert stated == {("uav1", False), ("uav3", False)}, "uav2 sends at 10 Hz"


def test_idle_cell_missing_one_stays_within_airtime() -> None:
    swarm = Storm(1, 16, loss=0.0, subscribed=False)
    swarm.run_for(15.0)
    gone = swarm.started.pop("uav1")
    gone.stop()
    hw, nodes = hardware_id("uav1"), swarm.started.values()
    for _ in range(18):
        for node in nodes:
            node.sent = node.sent_bytes = 0
        swarm.run_for(0.1)
        air_s = sum(node.sent * airtime_s(node.sent_bytes / node.sent) for node in nodes if node.sent)
        assert air_s < AIR * 0.1
    assert all(node.link_states[hw] is LinkState.DOWN for node in nodes)
