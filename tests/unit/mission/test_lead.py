"""The lead of a barrier over relays, hops and slowed beacons."""

import pytest

from swarmd.mission.core.barrier import LEAD_MAX_NS, lead_ns, lead_to_ns
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.net import ConnectionStatus, LinkStatus, Neighbours, NeighbourState, Routes, RouteState

S = 1_000_000_000
MIN = S // 4


def route(platform: str, via: str, hops: int) -> RouteState:
    return RouteState(platform, 1, via, 256 * hops, hops, 0, 0)


def neighbour(platform: str, tick_hz: float) -> NeighbourState:
    return NeighbourState(
        platform,
        "main",
        1,
        PlatformKind.UAV,
        LinkStatus.UP,
        "127.0.0.1:1",
        0,
        0.0,
        tick_hz,
        0.0,
        0.0,
        None,
        256,
        0,
        0,
        0,
        ConnectionStatus.CONNECTED,
        True,
    )


def lead_s(
    *platforms: str, own_hz: float = 10.0, routes: tuple[RouteState, ...] = (), **tick_hz: float
) -> float:
    neighbours = Neighbours(tuple(neighbour(name, hz) for name, hz in tick_hz.items()))
    found_ns = lead_to_ns(platforms, min_ns=MIN, own_hz=own_hz, routes=Routes(routes), neighbours=neighbours)
    return found_ns / S


@pytest.mark.parametrize(
    ("beacon_hz", "hops", "expected_s"),
    [
        (10.0, 1, 0.25),
        (10.0, 0, 0.25),
        (50.0, 1, 0.25),
        (10.0, 3, 0.75),
        (1.0, 1, 2.5),
        (0.2, 4, 5.0),
        (0.0, 1, 0.25),
    ],
)
def test_common_time_leaves_news_time_to_travel(beacon_hz: float, hops: int, expected_s: float) -> None:
    assert lead_ns(MIN, beacon_hz, hops) == round(expected_s * S)


def test_the_farthest_member_sets_the_hops() -> None:
    near, far = route("uav1", "uav1", 1), route("uav2", "uav1", 4)
    assert lead_s("uav1", "uav2", routes=(near, far), uav1=10.0) == 1.0
    assert lead_s("uav1", routes=(near, far), uav1=10.0) == 0.25, "who is no member sets nothing"


def test_a_relay_that_sends_slower_sets_the_rate() -> None:
    far = route("uav2", "uav1", 2)
    assert lead_s("uav2", routes=(far,), uav1=2.0) == 2.5
    assert lead_s("uav2", routes=(far,), uav1=20.0) == 0.5, "the own rate is the slower one"


def test_a_slow_neighbour_that_relays_nothing_sets_nothing() -> None:
    direct = route("uav1", "uav1", 1)
    assert lead_s("uav1", routes=(direct,), uav1=1.0, uav3=1.0) == 0.25


def test_a_slowed_own_beacon_lengthens_the_lead() -> None:
    direct = route("uav1", "uav1", 1)
    assert lead_s("uav1", own_hz=1.0, routes=(direct,), uav1=10.0) == 2.5


def test_an_unknown_rate_is_no_rate() -> None:
    far = route("uav2", "uav1", 2)
    assert lead_s("uav2", own_hz=0.0, routes=(far,), uav1=5.0) == 1.0, "the relay's is known"
    assert lead_s("uav2", own_hz=0.0, routes=(far,), uav1=0.0) == 0.25, "none is"


def test_a_lead_has_an_end() -> None:
    far = route("uav2", "uav1", 14)
    assert lead_s("uav2", own_hz=1.0, routes=(far,), uav1=1.0) * S == LEAD_MAX_NS


def test_node_without_network_knowledge_takes_shortest() -> None:
    assert lead_to_ns(("uav1",), min_ns=MIN, own_hz=0.0, routes=None, neighbours=None) == MIN
