"""The simulation's core under its driver: it wakes with its sensors, and a request to the motors wakes it."""

import random
from typing import Final

import pytest

from swarmd.sim.config import Config
from swarmd.sim.core.simulation import Simulation
from swarmd.sim.core.vehicle_core import Action, PublishOutput, PublishReport, ReadBoards, VehicleCore
from swarmware.geometry.world import Bounds, World
from swarmware.model.platform_kind import PlatformKind
from swarmware.testing.virtual import VirtualTime
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import Pose, Setpoint

WORLD: Final = World(description="", bounds=Bounds(x_m=(-20.0, 20.0), y_m=(-20.0, 20.0)))
MS: Final = 1_000_000


class Rig:
    """The core of one vehicle in virtual time, with the set-point that its shell would read."""

    def __init__(self, kind: str = "ugv") -> None:
        chance = random.Random(1)
        self.time = VirtualTime(5_000 * MS)
        self.simulation = Simulation(
            Config(), WORLD, PlatformKind(kind), Pose.planar(0.0, 0.0), chance.gauss, chance.random
        )
        self.core = VehicleCore(Config(), self.simulation)
        self.driver = self.time.drive(self.core, self.perform)
        self.setpoint: Setpoint | None = None
        self.neighbour: Pose | None = None
        self.actions: list[Action] = []
        self.orders = 0
        self.driver.feed()

    def perform(self, action: Action) -> None:
        self.actions.append(action)
        if isinstance(action, ReadBoards):
            now_ns = self.time.now_ns
            if self.setpoint is not None:
                self.driver.feed(self.core.on_command(self.setpoint, now_ns, now_ns))
            if action.neighbours and self.neighbour is not None:
                self.driver.feed(self.core.on_neighbour("ugv2", self.neighbour, now_ns, now_ns))
            self.driver.feed(self.core.on_boards_read(now_ns))

    def order(self, action: ChassisAction, number: int = 0) -> ChassisReport:
        self.orders = number or self.orders + 1
        (done,) = self.core.on_order(ChassisOrder(self.orders, action), self.time.now_ns)
        assert isinstance(done, PublishReport)
        self.driver.feed([done])
        return done.report

    def outputs(self) -> list[PublishOutput]:
        return [action for action in self.actions if isinstance(action, PublishOutput)]


def test_vehicle_begins_at_once_reading_inputs_first() -> None:
    rig = Rig()
    rig.time.run_for(1.0)
    assert [type(action) for action in rig.actions[:4]] == [ReadBoards, PublishOutput] * 2
    assert len(rig.outputs()) == pytest.approx(Config().sensors.rest_hz, abs=2), "it rests"


def test_neighbours_are_read_at_check_rate() -> None:
    rig = Rig()
    rig.order(ChassisAction.ARM)
    rig.setpoint = Setpoint(0.5)
    rig.neighbour = Pose.planar(1.5, 0.0)
    rig.time.run_for(3.0)
    reads = [action.neighbours for action in rig.actions if isinstance(action, ReadBoards)]
    assert sum(reads) == pytest.approx(3 * Config().contacts_hz, abs=2)
    hits = [hit.other for action in rig.outputs() for hit in action.output.collisions]
    assert "ugv2" in hits


def test_motor_request_is_published_and_hastens_sample() -> None:
    rig = Rig()
    rig.time.run_for(2.0)
    assert rig.order(ChassisAction.ARM).armed
    before_ns = rig.time.now_ns
    rig.actions.clear()
    rig.setpoint = Setpoint(1.0)
    rig.time.run_for(0.05)
    assert rig.outputs()
    assert rig.outputs()[0].output.stamp_ns - before_ns <= 50 * MS, (
        "not with the next one of a vehicle at rest"
    )


def test_killed_vehicle_is_disarmed_refusal_changes_nothing() -> None:
    rig = Rig("uav")
    rig.order(ChassisAction.ARM)
    rig.setpoint = Setpoint(0.0, 0.0, 2.0)
    rig.time.run_for(2.0)
    refused = rig.order(ChassisAction.DISARM)
    assert refused.armed
    assert "in the air" in refused.refused
    killed = rig.order(ChassisAction.KILL)
    assert (killed.armed, killed.refused) == (False, "")


def test_repeated_order_is_executed_once_and_answered_again() -> None:
    rig = Rig()
    rig.order(ChassisAction.ARM, 7)
    disarmed = rig.order(ChassisAction.DISARM, 8)
    assert rig.order(ChassisAction.ARM, 7) == disarmed == ChassisReport(armed=False, landed=True, answered=8)


@pytest.mark.parametrize("kind", ["ugv", "uav"])
def test_only_resting_vehicle_is_calibrated(kind: str) -> None:
    rig = Rig(kind)
    assert rig.order(ChassisAction.CALIBRATE).refused == ""
    rig.order(ChassisAction.ARM)
    assert "disarmed and on the ground" in rig.order(ChassisAction.CALIBRATE).refused
    assert rig.order(ChassisAction("wave")).refused == "wave: not supported by the simulated chassis"
