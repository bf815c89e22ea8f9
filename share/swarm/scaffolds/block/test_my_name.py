"""Tests of the block MyName without a node: its plan, its run, a mission with it."""

import asyncio
from pathlib import Path

import pytest
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import BLOCKS, Catalogue
from swarmware.mission.check import check_text
from swarmware.mission.finding import Finding
from swarmware.mission.plugin import BlockError
from swarmware.testing.blocks import RecordedContext, RecordedVehicle
from swarmware.types.vehicle import Pose

from my_name import MyName, Parameters, plan

MISSION = Path(__file__).with_name("mission.json").read_text("utf-8")


def findings(mission: str) -> list[Finding]:
    """What `swarmctl mission check` would print about a mission."""
    catalogue = Catalogue((*BLOCKS, MyName.spec))
    return check_text(mission, "mission.json", Binding(), catalogue)[1]


def test_plan_visits_corners_and_returns() -> None:
    corners = [(5.0, 2.0), (5.0, 6.0), (1.0, 6.0), (1.0, 2.0)]
    assert plan(Parameters(side_m=4.0, rounds=2), 1.0, 2.0) == corners * 2


def test_the_vehicle_keeps_its_height_on_the_way() -> None:
    vehicle = RecordedVehicle(Pose(0.0, 0.0, 7.5))
    context = RecordedContext(Parameters(side_m=4.0), vehicle)
    asyncio.run(MyName().run(context))
    assert vehicle.visited == [(4.0, 0.0, 7.5), (4.0, 4.0, 7.5), (0.0, 4.0, 7.5), (0.0, 0.0, 7.5)]
    assert context.reports[-1] == (0.75, "to corner 4 of 4")


def test_blocked_way_ends_block_with_error() -> None:
    vehicle = RecordedVehicle(Pose(0.0, 0.0, 7.5))
    vehicle.refuse[1] = BlockError("blocked", "a tree")
    with pytest.raises(BlockError, match="a tree"):
        asyncio.run(MyName().run(RecordedContext(Parameters(), vehicle)))
    assert len(vehicle.visited) == 1


def test_the_mission_with_the_block_is_sound() -> None:
    assert findings(MISSION) == []


def test_value_outside_bounds_is_refused_before_moving() -> None:
    (finding,) = findings(MISSION.replace('"side_m": 5.0', '"side_m": -5.0'))
    assert "parameter 'side_m' of MyName: expected `float` > 0" in finding.message
