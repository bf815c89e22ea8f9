"""Who the nodes of a lab are."""

import pytest

from swarmlab.provision import plan
from swarmware.errors import InvalidInput


@pytest.mark.parametrize(
    ("nodes", "expected"), [(16, (5, 10)), (6, (2, 3)), (4, (1, 2)), (3, (1, 1)), (50, (16, 33))]
)
def test_one_third_of_vehicles_is_on_ground(nodes: int, expected: tuple[int, int]) -> None:
    assert plan.kinds(nodes) == expected


@pytest.mark.parametrize("nodes", [-1, 0, 2, 201])
def test_a_number_that_makes_no_swarm_is_refused(nodes: int) -> None:
    with pytest.raises(InvalidInput, match="number of nodes"):
        plan.kinds(nodes)


def test_same_seed_gives_same_swarm() -> None:
    assert plan.members(16, 7) == plan.members(16, 7)
    assert plan.members(16, 7) != plan.members(16, 8)


def test_clocks_differ_and_stay_within_what_is_promised() -> None:
    who = plan.members(16, 1)
    assert all(abs(m.offset_s) <= 5 and abs(m.drift_ppm) <= 50 for m in who)
    assert len({m.offset_s for m in who}) == 16
    assert [m.platform for m in who][:3] == ["gcs", "ugv1", "ugv2"]


def test_nodes_start_in_random_order_that_seed_repeats() -> None:
    who = [member.platform for member in plan.members(16, 1)]
    orders = {tuple(plan.start_order(who, seed)) for seed in range(20)}
    assert len(orders) == 20
    assert plan.start_order(who, 3) == plan.start_order(who, 3)
    assert all(sorted(order) == sorted(who) for order in orders)


def test_surface_vessels_are_asked_for_by_number() -> None:
    assert [m.platform for m in plan.members(6, 1, 2)] == ["gcs", "ugv1", "usv1", "usv2", "uav1", "uav2"]
    assert {m.kind for m in plan.members(6, 1, 2)} == {"gcs", "ugv", "usv", "uav"}
    for wrong in (-1, 4):
        with pytest.raises(InvalidInput, match="surface vessels"):
            plan.members(6, 1, wrong)


def test_process_for_each_service_on_any_of_nodes() -> None:
    who = plan.members(4, 1)
    assert plan.per_daemon(None, who) == frozenset()
    assert plan.per_daemon("all", who) == {"gcs", "ugv1", "uav1", "uav2"}
    assert plan.per_daemon("uav1, gcs", who) == {"uav1", "gcs"}
    with pytest.raises(InvalidInput, match="usv9"):
        plan.per_daemon("uav1,usv9", who)


def test_airframes_go_to_all_or_some_vehicles() -> None:
    who = plan.members(4, 1)
    assert plan.airframes((), who) == {}
    assert plan.airframes(("helicopter",), who) == {"uav1": "helicopter", "uav2": "helicopter"}
    both = plan.airframes(("quad_1k5", "uav2=fixed_wing"), who)
    assert both == {"uav1": "quad_1k5", "uav2": "fixed_wing"}
    with pytest.raises(InvalidInput, match="--airframe ugv1: no such node; expected some of uav1, uav2"):
        plan.airframes(("ugv1=helicopter",), who)


def test_only_vehicles_are_distributed_over_computers() -> None:
    who = plan.members(4, 1)
    assert plan.distributed(None, who) == frozenset()
    assert plan.distributed("all", who) == {"ugv1", "uav1", "uav2"}
    assert plan.distributed("uav2", who) == {"uav2"}
    for wrong in ("gcs", "uav7"):
        with pytest.raises(InvalidInput, match=f"--units {wrong}"):
            plan.distributed(wrong, who)


def test_further_services_are_installed_and_not_standard() -> None:
    usual = {"broker", "tree"}
    assert plan.extra_services((), usual) == ()
    assert plan.extra_services(("files", "tree", "files"), usual) == ("files",)
    with pytest.raises(InvalidInput, match=r"--service file: not installed; expected one of .*files"):
        plan.extra_services(("files", "file"), usual)
