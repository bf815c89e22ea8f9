"""The vehicles of a swarm in virtual time: real cores, a lossy radio, a scripted mission."""

import math
import random
from collections.abc import Callable
from pathlib import Path

import msgspec

from swarmd.navigator.config import Config as NavConfig
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.ground_controller import GroundController
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.core.simulation import Simulation, SimulationOutput
from swarmware.geometry.formation import FormationSlots, place
from swarmware.geometry.world import World
from swarmware.model.config import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.navigation import Collision, Goal, GoalKind, NavState, NavStatus
from swarmware.types.vehicle import Pose

ROOT = Path(__file__).parents[3]
COURSE = ((0.0, 0.0), (32.0, 0.0), (62.0, 20.0), (95.0, 20.0))
GROUND_SPACING_M = 4.0
AIR_SPACING_M = 3.0
AIR_HEAD_M = (-6.0, 0.0, 8.0)
AIR_STEP_M = 0.4
"""Each flies higher than the one before, as in share/swarm/missions/formation."""
SPEED_M_S = 2.0
STEP_NS = 10_000_000
"""Resolution of virtual time."""


def world(name: str = "formation") -> World:
    return load(ROOT / f"share/swarm/worlds/{name}.toml", World)


class Vehicle:
    """One platform with simulation, navigator, and the exchange of a node between them."""

    def __init__(self, name: str, kind: str, number: int, where: World, seed: int, radio: "Radio") -> None:
        self.name, self.kind = name, kind
        chance = random.Random(f"{seed} {name}")
        self._chance = chance
        self._radio = radio
        start = where.start_pose(kind, number, (chance.uniform(-1, 1), chance.uniform(-1, 1)))
        config = SimConfig()
        self.simulation = Simulation(config, where, PlatformKind(kind), start, chance.gauss, chance.random)
        nav = NavConfig()
        pilot = AirController(nav) if kind == "uav" else GroundController(nav)
        self.navigator = NavigatorCore(nav, name, where.origin, pilot)
        self.collisions: list[Collision] = []
        self.stalls_hz = 0.0
        self.status = NavStatus(0, NavState.IDLE)
        self.truth = start
        self.told: Pose | None = None
        # services of a node do not run in step with each other
        self._next_sim_ns = chance.randrange(20_000_000)
        self._next_nav_ns = chance.randrange(50_000_000)
        self._next_tick_ns = chance.randrange(100_000_000)
        head, spacing = ((0.0, 0.0, 0.0), GROUND_SPACING_M) if kind == "ugv" else (AIR_HEAD_M, AIR_SPACING_M)
        forward, left = place("wedge", number - 1, spacing)
        up = head[2] + (AIR_STEP_M * (number - 1) if kind == "uav" else 0.0)
        self.offset_m = (head[0] + forward, head[1] + left, up)

    def run(self, now_ns: int) -> None:
        if self.stalls_hz and self._chance.random() < self.stalls_hz * STEP_NS / 1e9:
            # the computer did something else: all services of the node are late together
            pause_ns = self._chance.randrange(500_000_000)
            self._next_sim_ns = max(self._next_sim_ns, now_ns + pause_ns)
            self._next_nav_ns = max(self._next_nav_ns, now_ns + pause_ns)
            self._next_tick_ns = max(self._next_tick_ns, now_ns + pause_ns)
        if now_ns >= self._next_sim_ns:
            self._next_sim_ns += 20_000_000
            self._simulate(now_ns)
        if now_ns >= self._next_nav_ns:
            self._next_nav_ns += 50_000_000
            step = self.navigator.step(now_ns)
            self.told = step.pose
            self.simulation.on_command(step.setpoint, now_ns)
            self.status = step.status or self.status
        if now_ns >= self._next_tick_ns:
            self._next_tick_ns += 100_000_000 + self._chance.randrange(-5_000_000, 5_000_000)
            if self.told is not None:
                self._radio.send(self.name, Pose.unpack(self.told.pack()), now_ns)

    def _simulate(self, now_ns: int) -> None:
        sample = self.simulation.advance(now_ns)
        if sample is None:
            return
        self.truth = sample.truth
        self.collisions += sample.collisions
        self.measure(sample)

    def measure(self, sample: SimulationOutput) -> None:
        navigator, stamp_ns = self.navigator, sample.stamp_ns
        if sample.imu is not None:
            navigator.on_imu(sample.imu, stamp_ns)
        if sample.gnss is not None:
            navigator.on_gnss(sample.gnss, stamp_ns)
        if sample.scan is not None:
            navigator.on_scan(sample.scan, stamp_ns)
        if sample.report is not None:
            navigator.on_vehicle(self.simulation.state())

    def receive(self, name: str, pose: Pose, stamp_ns: int) -> None:
        self.navigator.on_neighbour(name, pose, stamp_ns)
        self.simulation.on_neighbour(name, pose, stamp_ns)


class Radio:
    """Poses travel with delay and loss."""

    def __init__(self, seed: int, loss_ratio: float, delay_ns: int) -> None:
        self._chance = random.Random(f"radio {seed}")
        self._loss_ratio, self._delay_ns = loss_ratio, delay_ns
        self._air: list[tuple[int, str, str, Pose, int]] = []
        self.names: list[str] = []
        self.silent: set[str] = set()

    def send(self, name: str, pose: Pose, now_ns: int) -> None:
        if name in self.silent:
            return
        for other in self.names:
            if other != name and self._chance.random() >= self._loss_ratio:
                arrival = now_ns + 1_000_000 + self._chance.randrange(self._delay_ns)
                self._air.append((arrival, other, name, pose, now_ns))

    def arrived(self, now_ns: int) -> list[tuple[int, str, str, Pose, int]]:
        here = [item for item in self._air if item[0] <= now_ns]
        self._air = [item for item in self._air if item[0] > now_ns]
        return here


class Result(msgspec.Struct):
    completed: bool = False
    arrived: bool = False
    duration_s: float = 0.0
    formed_s: float = 0.0
    errors_m: list[float] = []
    least_separation_m: float = math.inf
    collisions: list[str] = []

    @property
    def mean_error_m(self) -> float:
        return sum(self.errors_m) / len(self.errors_m)


class Flight:
    """The formation mission: arm, take off, take the slots, follow the course, land."""

    def __init__(self, nodes: int, seed: int, loss_ratio: float = 0.02, delay_ns: int = 20_000_000) -> None:
        vehicles = nodes - 1
        ground = max(1, round(vehicles / 3))
        where = world()
        self.radio = Radio(seed, loss_ratio, delay_ns)
        self.vehicles = [
            self.vehicle(f"{kind}{i}", kind, i, where, seed)
            for kind, count in (("ugv", ground), ("uav", vehicles - ground))
            for i in range(1, count + 1)
            if self.takes_part(kind, i)
        ]
        self.radio.names = [v.name for v in self.vehicles]
        self._by_name = {v.name: v for v in self.vehicles}
        self.now_ns = 1_000_000_000
        self._formation = FormationSlots(COURSE)
        self._seq = 0
        self.result = Result()
        self._measure = False

    def vehicle(self, name: str, kind: str, number: int, where: World, seed: int) -> Vehicle:
        return Vehicle(name, kind, number, where, seed, self.radio)

    def takes_part(self, kind: str, number: int) -> bool:
        return True

    def step(self) -> None:
        self.now_ns += STEP_NS
        for vehicle in self.vehicles:
            vehicle.run(self.now_ns)
        for _, receiver, sender, pose, stamp_ns in self.radio.arrived(self.now_ns):
            self._by_name[receiver].receive(sender, pose, stamp_ns)
        if self.now_ns % 50_000_000 == 0:
            self._look()

    def until(self, condition: Callable[[], bool], limit_s: float) -> bool:
        end_ns = self.now_ns + round(limit_s * 1e9)
        while self.now_ns < end_ns:
            self.step()
            if condition():
                return True
        return False

    def order(self, make: Callable[[Vehicle], Goal]) -> None:
        self._seq += 1
        for vehicle in self.vehicles:
            goal = msgspec.structs.replace(make(vehicle), seq=self._seq)
            vehicle.navigator.on_goal(goal, self.now_ns)

    def all_say(self, *states: str, kind: str = "") -> bool:
        return all(
            v.status.goal_seq == self._seq and v.status.state in states
            for v in self.vehicles
            if kind in {"", v.kind}
        )

    def fly(self) -> Result:
        """Flies the whole mission; the result contains its progress."""
        if self.form():
            self.advance()
            self.land()
        return self.result

    def form(self) -> bool:
        result = self.result
        self.until(lambda: all(v.told is not None for v in self.vehicles), 5)
        for vehicle in self.vehicles:
            vehicle.simulation.on_arm(True)
        self.order(
            lambda v: Goal(
                0, GoalKind.TAKEOFF if v.kind == "uav" else GoalKind.HOLD, z_m=v.offset_m[2], speed_m_s=2.0
            )
        )
        if not self.until(lambda: self.all_say("arrived", "holding"), 30):
            return False
        begin_ns = self.now_ns
        self.order(lambda v: self.formation(v, advance=False))
        formed = self.until(lambda: self.all_say("arrived"), 60)
        result.formed_s = (self.now_ns - begin_ns) / 1e9
        return formed

    def advance(self, limit_s: float = 120.0) -> bool:
        begin_ns = self.now_ns
        self._measure = True
        self.order(lambda v: self.formation(v, advance=True))
        self.result.arrived = self.until(lambda: self.all_say("arrived"), limit_s)
        self._measure = False
        self.result.duration_s = (self.now_ns - begin_ns) / 1e9
        return self.result.arrived

    def land(self) -> bool:
        self.order(lambda v: Goal(0, GoalKind.LAND, speed_m_s=1.5))
        landed = self.until(lambda: self.all_say("arrived"), 40)
        self.result.completed = landed and self.result.arrived
        return landed

    def formation(self, vehicle: Vehicle, *, advance: bool) -> Goal:
        return Goal(
            0,
            GoalKind.FORMATION,
            speed_m_s=SPEED_M_S,
            leader="ugv1",
            offset_m=vehicle.offset_m,
            course=COURSE,
            advance=advance,
        )

    def _look(self) -> None:
        result = self.result
        truths = [v.truth for v in self.vehicles]
        for i, a in enumerate(truths):
            for b in truths[i + 1 :]:
                gap = math.dist((a.x_m, a.y_m, a.z_m), (b.x_m, b.y_m, b.z_m))
                result.least_separation_m = min(result.least_separation_m, gap)
        for vehicle in self.vehicles:
            for hit in vehicle.collisions:
                result.collisions.append(f"{vehicle.name} hit {hit.other} at {self.now_ns / 1e9:.1f} s")
            vehicle.collisions.clear()
        if self._measure:
            leader = self._by_name["ugv1"].truth
            for vehicle in self.vehicles:
                slot = self._formation.slot(leader, vehicle.offset_m)
                result.errors_m.append(slot.error_m(vehicle.truth))
