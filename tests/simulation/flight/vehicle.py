"""One vehicle in virtual time: simulated body and sensors, median filter, flight controller, navigator."""

import math
import random
from collections.abc import Callable
from pathlib import Path

from swarmd.hal.core.flight.flight_core import FlightCore, control_law
from swarmd.hal.core.median import MedianFilter
from swarmd.navigator.config import Config as NavConfig
from swarmd.navigator.core.controller import controller
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.core.simulation import Simulation
from swarmware.geometry.attitude import to_euler
from swarmware.geometry.world import World
from swarmware.model.airframe_file import load_airframe
from swarmware.model.config import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder
from swarmware.types.navigation import Collision, Goal, NavState, NavStatus
from swarmware.types.vehicle import Setpoint

SHARE = Path(__file__).parents[3] / "share/swarm"
MS = 1_000_000
CONTROL_NS = 10 * MS
LATE_NS = 8 * MS
"""Stage of the actuators in a node with a process for each daemon: it sees the sample of 8 ms before."""
NAVIGATOR_NS = 50 * MS


class Flight:
    """Steps the cores of one vehicle; `commands`: set-points that replace the navigator's."""

    def __init__(
        self, airframe: str, seed: int, config: SimConfig | None = None, world: str = "field"
    ) -> None:
        self.airframe = load_airframe(SHARE, airframe)
        where = load(SHARE / f"worlds/{world}.toml", World)
        chance = random.Random(seed)
        start = where.start_pose("uav", 1, (chance.uniform(-1, 1), chance.uniform(-1, 1)))
        self.simulation = Simulation(
            config or SimConfig(),
            where,
            PlatformKind.UAV,
            start,
            chance.gauss,
            chance.random,
            self.airframe,
        )
        self.core = FlightCore(control_law(self.airframe))
        nav = NavConfig()
        self.navigator = NavigatorCore(
            nav, "uav1", where.origin, controller(PlatformKind.UAV, nav, self.airframe)
        )
        self.median = MedianFilter(5)
        self.now_ns = 0
        self.truth = start
        self.commands: Callable[[float], Setpoint] | None = None
        self.status = NavStatus(0, NavState.IDLE)
        self.collisions: list[Collision] = []
        self.gnss = True
        """Whether satellites are received."""
        self.number = 0
        self.setpoint = Setpoint(0.0)

    @property
    def time_s(self) -> float:
        return self.now_ns / 1e9

    @property
    def tilt_deg(self) -> tuple[float, float]:
        """True roll and pitch."""
        pose = self.truth
        roll, pitch, _ = to_euler((pose.qx, pose.qy, pose.qz, pose.qw))
        return math.degrees(roll), math.degrees(pitch)

    def order(self, action: ChassisAction) -> str:
        """Sends an order to the chassis; returns the reason of a refusal, or ""."""
        self.number += 1
        report = self.simulation.on_order(ChassisOrder(self.number, action))
        self._inform(report.armed, report.landed)
        return report.refused

    def goal(self, goal: Goal) -> None:
        self.navigator.on_goal(goal, self.now_ns)

    def step(self) -> None:
        """One period of the flight controller."""
        self.now_ns += CONTROL_NS
        now_ns = self.now_ns
        sample = self.simulation.advance(now_ns)
        if sample is not None:
            self.truth = sample.truth
            self.collisions += sample.collisions
            if sample.report is not None:
                self._inform(sample.report.armed, sample.report.landed)
            if sample.gnss is not None and self.gnss:
                self.core.on_gnss(sample.gnss, sample.stamp_ns, now_ns)
                self.navigator.on_gnss(sample.gnss, sample.stamp_ns)
            if sample.sonar is not None:
                height_m = self.median.add(sample.sonar.ranges_m[0])
                if height_m < sample.sonar.max_m:
                    self.core.on_height(height_m)
                    self.navigator.on_height(height_m)
            if sample.imu is not None:
                self.core.on_imu(sample.imu, sample.stamp_ns)
        if now_ns % NAVIGATOR_NS == 0:
            imu = self.core.take_imu()
            if imu is not None:
                self.navigator.on_imu(imu, now_ns)
            done = self.navigator.step(now_ns)
            self.status = done.status or self.status
            self.setpoint = done.setpoint
        if self.commands is not None:
            self.setpoint = self.commands(self.time_s)
        self.core.on_setpoint(self.setpoint)
        outputs = self.core.step(now_ns + LATE_NS)
        if outputs is not None:
            self.carry(outputs, now_ns + LATE_NS)

    def carry(self, outputs: ActuatorOutputs, now_ns: int) -> None:
        """Takes the outputs to the actuators."""
        self.simulation.on_command(outputs, now_ns)

    def run(self, duration_s: float, each: Callable[["Flight"], None] | None = None) -> None:
        end_ns = self.now_ns + round(duration_s * 1e9)
        while self.now_ns < end_ns:
            self.step()
            if each is not None:
                each(self)

    def run_until(self, right: Callable[["Flight"], bool], limit_s: float) -> None:
        end_ns = self.now_ns + round(limit_s * 1e9)
        while not right(self):
            assert self.now_ns < end_ns, f"not within {limit_s} s: {self.truth}, {self.status}"
            self.step()

    def _inform(self, armed: bool, landed: bool) -> None:
        self.core.on_vehicle(armed=armed, landed=landed)
        self.navigator.on_vehicle(self.simulation.state())
