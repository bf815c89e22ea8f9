"""Reach, quality, repetitions, and the settings of the service."""

import pytest
from tests.unit.tree.neighbours import neighbour

from swarmd.tree.config import Config
from swarmd.tree.core.structure.index import leaf
from swarmd.tree.core.tree import Reachability, reachable
from swarmd.tree.core.values.quality import quality
from swarmware.errors import ConfigError
from swarmware.model.config import parse
from swarmware.model.names import hardware_id
from swarmware.model.resource import Resource
from swarmware.types.net import Neighbours, Routes, RouteState
from swarmware.types.tree import Rule


def route(platform: str, via: str, version: int = 5, hardware: int | None = None) -> RouteState:
    hw = hardware_id(platform) if hardware is None else hardware
    return RouteState(platform, hw, via, 256, 1, version, 0)


def test_routed_nodes_are_reachable_and_neighbours_near() -> None:
    routes = Routes((route("uav1", "uav1"), route("uav2", "uav1", 7), route("gcs", "gcs")))
    neighbours = Neighbours((neighbour("uav1", "up", 6), neighbour("uav3", "half_open")))
    assert reachable("gcs", neighbours, routes) == {
        "uav1": Reachability(6, True, multicast=True),
        "uav2": Reachability(7, False),
    }
    assert reachable("gcs", None, None) == {}


def test_unnamed_node_is_omitted_units_are_nodes() -> None:
    routes = Routes((route("a1b2c3d4", "a1b2c3d4", hardware=0xA1B2C3D4),))
    neighbours = Neighbours((neighbour("uav1", "up", unit="fc1"), neighbour("", "up")))
    assert reachable("gcs", neighbours, routes).keys() == {"uav1.fc1"}
    assert reachable("uav1", neighbours, routes).keys() == {"uav1.fc1"}
    assert reachable("uav1.fc1", neighbours, routes) == {}


def test_unannounced_version_is_absent() -> None:
    assert reachable("gcs", None, Routes((route("uav1", "uav1", 0),))) == {"uav1": Reachability(None, True)}


POSE = Resource(path="nav/pose", type="Pose", rate_hz=10.0)
STATE = Resource(path="vehicle/state", type="VehicleState")


@pytest.mark.parametrize(
    ("resource", "lost", "age_s", "reachable_now", "known", "expected"),
    [
        (POSE, False, 0.1, True, True, "live"),
        (POSE, False, 0.4, True, True, "stale"),
        (POSE, False, None, True, True, "stale"),
        (POSE, False, None, True, False, "none"),
        (POSE, True, 0.1, True, True, "lost"),
        (POSE, False, 0.1, False, True, "lost"),
        (STATE, False, 5000.0, True, True, "live"),
        (STATE, False, None, True, True, "live"),
    ],
)
def test_quality_is_of_owner_age_and_way(
    resource: Resource, lost: bool, age_s: float | None, reachable_now: bool, known: bool, expected: str
) -> None:
    assert quality(leaf(resource, lost=lost), age_s, reachable=reachable_now, known=known) == expected


def test_resting_boards_mirror_is_live_between_beacons() -> None:
    def seen(resource: Resource, age_s: float) -> str:
        return quality(leaf(resource), age_s, reachable=True, known=True, mirrored=True)

    assert seen(POSE, 0.6) == "live"
    assert seen(POSE, 1.3) == "stale"
    assert seen(Resource(path="x", type="Float", rate_hz=10.0, link="request"), 0.6) == "stale"


@pytest.mark.parametrize(
    ("max_age_s", "interval_s", "age_s", "expected"),
    [
        (0.0, 2.0, 5.9, "live"),
        (0.0, 2.0, 6.1, "stale"),
        (0.5, 2.0, 5.9, "live"),
        (9.0, 2.0, 8.9, "live"),
        (0.0, 0.0, 1.3, "stale"),
        (0.0, 0.1, 1.2, "live"),
    ],
)
def test_board_sent_rarely_is_stale_later(
    max_age_s: float, interval_s: float, age_s: float, expected: str
) -> None:
    pose = Resource(path="nav/pose", type="Pose", rate_hz=10.0, max_age_s=max_age_s)
    found = quality(leaf(pose), age_s, reachable=True, known=True, mirrored=True, interval_s=interval_s)
    assert found == expected


def test_rules_of_configuration_are_rules_on_wire() -> None:
    config = parse(
        'rules = [{ pattern = "power/**", deadband = 0.01, min_interval_s = 1.0 }]', Config, "tree.toml"
    )
    assert [rule.rule() for rule in config.rules] == [Rule("power/**", 0.01, 1.0, 0.0)]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('rules = [{ pattern = "power/{" }]', "'{' is not closed"),
        ("rules = [{ deadband = 0.01 }]", "pattern"),
        ("lease_s = 0.1", "lease_s"),
        ("retry_s = []", "retry_s"),
        ("patience = 3", "patience"),
    ],
)
def test_a_mistake_in_the_configuration_is_named(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse(text, Config, "tree.toml")
