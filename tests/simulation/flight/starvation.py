"""A vehicle whose processes pause, in virtual time: loss of height, and recovery of the attitude.

`python -m tests.simulation.flight.starvation --pauses 200` prints the figures by the length of the pause.
"""

import argparse
import math
import random
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from typing import Any

import msgspec
from tests.simulation.flight.vehicle import CONTROL_NS, LATE_NS, NAVIGATOR_NS, Flight

from swarmd.control.config import Config as ControlConfig
from swarmd.control.core.control import ControlCore, WriteDrive
from swarmd.hal.core.chassis_core import ChassisCore
from swarmd.hal.core.condition import Condition
from swarmd.hal.core.flight.flight_core import FlightCore, FlightHandover, FlightTiming, control_law
from swarmd.hal.core.median import MedianFilter
from swarmd.sim.config import Config as SimConfig
from swarmd.sim.config import WindConfig
from swarmd.sim.core.flying_body import FlyingBody
from swarmware.geometry.attitude import to_euler
from swarmware.types.chassis import ChassisAction, ChassisReport
from swarmware.types.control import Drive
from swarmware.types.navigation import Goal, GoalKind, NavState
from swarmware.types.vehicle import Pose, VehicleState

GUSTS = SimConfig(wind=WindConfig(mean_m_s=(4.0, 2.0, 0.0), gust_sigma_m_s=1.0, gust_tau_s=2.0))
PARTS = ("hal", "sim", "navigator", "control")
TOGETHER = (("hal",), ("sim",), ("navigator",), ("control",), ("hal", "sim"), ("navigator", "control"), PARTS)
HEIGHT_M = 5.0
LEVEL_DEG = 15.0
"""Tilt from which it is level: in these gusts it leans against the wind by up to 11°."""
WATCHED_S = 6.0
"""Time after a pause in which it is watched."""


class StarvedFlight(Flight):
    """A flight whose parts read the newest values of boards, and only while they are not paused."""

    def __init__(self, airframe: str, seed: int, config: SimConfig | None = None) -> None:
        super().__init__(airframe, seed, config)
        self.core = self.flight_core()
        self.control = ControlCore(ControlConfig())
        self.chassis = ChassisCore(0.5)
        self.boards: dict[str, tuple[Any, int]] = {}
        """The newest value of each board, with its stamp."""
        self.taken: dict[tuple[str, str], Any] = {}
        """The value of a board that a part has taken."""
        self.until_ns = dict.fromkeys(PARTS, 0)
        """End of the pause of each part."""
        self.navigator_ns = NAVIGATOR_NS
        """When the navigator is due."""
        self.rng = random.Random(seed)
        self.conditions: list[Condition] = []
        """Conditions that the flight controller has stated."""
        self.report = ChassisReport(False, True)

    def flight_core(self) -> FlightCore:
        timing = FlightTiming(1 / self.airframe.control_hz, self.airframe.body.outputs_held_s)
        return FlightCore(control_law(self.airframe), timing)

    @property
    def tilt_rad(self) -> float:
        """True angle of the body from the vertical."""
        vehicle = self.simulation.vehicle
        assert isinstance(vehicle, FlyingBody)
        pose = vehicle.pose()
        roll, pitch, _ = to_euler((pose.qx, pose.qy, pose.qz, pose.qw))
        return math.acos(math.cos(roll) * math.cos(pitch))

    @property
    def states(self) -> list[str]:
        """Reported states by check."""
        return [f"{one.name} {one.state}" for one in self.conditions if one.state != "ok"]

    def pause(self, parts: Sequence[str], duration_s: float) -> None:
        """Stops parts from now on, as SIGSTOP does."""
        for part in parts:
            self.until_ns[part] = self.now_ns + round(duration_s * 1e9)

    def restart_hal(self, away_s: float) -> None:
        """Kills the flight controller; a new process continues later from the boards."""
        self.pause(("hal",), away_s)
        imu, stamp_ns = self.boards["imu_mean"]
        pose: Pose = self.boards["pose"][0]
        self.core = self.flight_core()
        handover = FlightHandover(imu, stamp_ns, pose.z_m, (pose.vx_m_s, pose.vy_m_s, pose.vz_m_s))
        self.core.on_handover(handover)
        self.core.on_vehicle(armed=self.report.armed, landed=self.report.landed)
        self.median = MedianFilter(5)
        self.chassis = ChassisCore(0.5)
        self.chassis.on_opened(self.now_ns)
        self.chassis.on_report(self.report, self.now_ns)

    def awake(self, part: str) -> bool:
        return self.now_ns >= self.until_ns[part]

    def step(self) -> None:
        """One period of the flight controller."""
        self.now_ns += CONTROL_NS
        if self.awake("sim"):
            self._simulate()
        if self.awake("navigator") and self.now_ns >= self.navigator_ns:
            self._navigate()
        if self.awake("control") and (found := self._new("control", "setpoint")) is not None:
            for action in self.control.on_setpoint(found[0], found[1], self.now_ns):
                if isinstance(action, WriteDrive):
                    self.boards["drive"] = (action.drive, action.stamp_ns)
        if self.awake("hal"):
            self._fly()

    def _new(self, part: str, board: str) -> tuple[Any, int] | None:
        """The value of a board that the part has not taken yet."""
        found = self.boards.get(board)
        if found is None or self.taken.get((part, board)) is found:
            return None
        self.taken[part, board] = found
        return found

    def _simulate(self) -> None:
        sample = self.simulation.advance(self.now_ns)
        if sample is None:
            return
        self.truth = sample.truth
        self.collisions += sample.collisions
        for name, value in (
            ("gnss", sample.gnss),
            ("sonar", sample.sonar),
            ("imu", sample.imu),
            ("report", sample.report),
        ):
            if value is not None:
                self.boards[name] = (value, sample.stamp_ns)

    def _navigate(self) -> None:
        now_ns = self.now_ns
        late_ns = now_ns - self.navigator_ns
        self.navigator_ns = (now_ns // NAVIGATOR_NS + 1) * NAVIGATOR_NS
        if (fix := self._new("navigator", "fix")) is not None:
            self.navigator.on_gnss(*fix)
        if (imu := self._new("navigator", "imu_mean")) is not None:
            self.navigator.on_imu(*imu)
        if (height := self._new("navigator", "height")) is not None:
            self.navigator.on_height(height[0])
        if (state := self._new("navigator", "state")) is not None:
            self.navigator.on_vehicle(state[0])
        done = self.navigator.step(now_ns, late_ns)
        self.status = done.status or self.status
        self.boards["setpoint"] = (done.setpoint, now_ns)
        if done.pose is not None:
            self.boards["pose"] = (done.pose, now_ns)

    def _fly(self) -> None:
        now_ns, core = self.now_ns, self.core
        if (report := self._new("hal", "report")) is not None:
            self.report = report[0]
            self._inform(self.report.armed, self.report.landed)
            self.chassis.on_report(*report)
        if (fix := self._new("hal", "gnss")) is not None:
            self.boards["fix"] = fix
            core.on_gnss(*fix, now_ns)
        if (sonar := self._new("hal", "sonar")) is not None:
            height_m = self.median.add(sonar[0].ranges_m[0])
            if height_m < sonar[0].max_m:
                self.boards["height"] = (height_m, sonar[1])
                core.on_height(height_m)
        if (drive := self._new("hal", "drive")) is not None:
            found: Drive = drive[0]
            self.chassis.on_setpoint(found.setpoint, drive[1])
        if (output := self.chassis.output(now_ns)) is not None:
            core.on_setpoint(output.setpoint)
        if (imu := self._new("hal", "imu")) is not None:
            core.on_imu(*imu)
        outputs = core.step(now_ns + LATE_NS)
        if outputs is not None:
            self.carry(outputs, now_ns + LATE_NS)
        if core.lost:
            self.order(ChassisAction.KILL)
        self.conditions += core.watch.conditions(now_ns)
        if now_ns % NAVIGATOR_NS == 0 and (mean := core.take_imu()) is not None:
            self.boards["imu_mean"] = (mean, core.imu_ns)

    def _inform(self, armed: bool, landed: bool) -> None:
        self.core.on_vehicle(armed=armed, landed=landed)
        self.boards["state"] = (VehicleState(armed, landed), self.now_ns)


class PauseFigures(msgspec.Struct, frozen=True):
    """Effects of one pause on a vehicle that held its position."""

    parts: tuple[str, ...]
    duration_s: float
    lost_m: float
    """Height lost from its begin to the lowest point."""
    overshoot_m: float
    """Height above the height at its begin."""
    level_s: float
    """Time from the end of the pause until it is level for good; infinite when it never is."""
    tilt_deg: float
    """Largest true tilt after the pause."""
    motors_stopped: bool
    touched: bool
    states: tuple[str, ...]


def hovering(
    airframe: str, seed: int, config: SimConfig = GUSTS, height_m: float = HEIGHT_M
) -> StarvedFlight:
    """A flight that holds its place."""
    flight = StarvedFlight(airframe, seed, config)
    flight.run(2.0)
    refused = flight.order(ChassisAction.ARM)
    assert not refused, refused
    flight.goal(Goal(1, GoalKind.TAKEOFF, z_m=height_m))
    flight.run_until(lambda f: f.status.goal_seq == 1 and f.status.state is NavState.ARRIVED, 40.0)
    flight.goal(Goal(2, GoalKind.HOLD))
    flight.run(5.0)
    assert flight.states == [], flight.states
    return flight


def pause(
    flight: StarvedFlight, parts: tuple[str, ...], duration_s: float, *, kill: bool = False
) -> PauseFigures:
    """Pauses parts of a vehicle and watches it; `kill`: another process of the flight controller takes
    over."""
    begin, end_s = flight.truth, flight.time_s + duration_s
    flight.conditions.clear()
    lowest = highest = begin.z_m
    uneven_s, tilt_deg = flight.time_s, 0.0
    stopped = landed = False

    def watch(now: Flight) -> None:
        nonlocal lowest, highest, uneven_s, tilt_deg, stopped, landed
        vehicle = now.simulation.vehicle
        z_m = vehicle.pose().z_m
        lowest, highest = min(lowest, z_m), max(highest, z_m)
        assert isinstance(now, StarvedFlight)
        tilted = math.degrees(now.tilt_rad)
        tilt_deg = max(tilt_deg, tilted)
        if tilted > LEVEL_DEG:
            uneven_s = now.time_s
        in_force = now.simulation._command  # what the motors have
        old = now.now_ns - now.simulation._command_ns > now.airframe.body.outputs_held_s * 1e9 + 30_000_000
        stopped = stopped or not vehicle.armed or not in_force or (old and now.awake("sim"))
        landed = landed or vehicle.landed

    if kill:
        flight.restart_hal(duration_s)
    else:
        flight.pause(parts, duration_s)
    flight.run(duration_s + WATCHED_S, watch)
    flies = flight.simulation.vehicle.armed and not flight.simulation.vehicle.landed
    return PauseFigures(
        parts,
        duration_s,
        begin.z_m - lowest,
        highest - begin.z_m,
        max(0.0, uneven_s - end_s) if flies else math.inf,
        tilt_deg,
        stopped,
        landed,
        tuple(flight.states),
    )


def measure(
    airframe: str, seed: int, durations_s: Sequence[float], parts: tuple[str, ...], kill: bool = False
) -> list[PauseFigures]:
    """One pause of each length, each of a vehicle that has just risen."""
    found = []
    for index, duration_s in enumerate(durations_s):
        flight = hovering(airframe, seed * 1000 + index)
        flight.run(flight.rng.uniform(0.0, 3.0))
        found.append(pause(flight, parts, duration_s, kill=kill))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("airframes", nargs="*", default=["quad_1k5", "hexa_14k", "helicopter"])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--kill", action="store_true")
    options = parser.parse_args()
    durations = (0.2, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.5)
    with ProcessPoolExecutor(2) as pool:
        for airframe in options.airframes:
            for parts in (("hal",),) if options.kill else TOGETHER:
                seeds = range(1, options.seeds + 1)
                runs = list(
                    pool.map(
                        measure,
                        repeat(airframe),
                        seeds,
                        repeat(durations),
                        repeat(parts),
                        repeat(options.kill),
                    )
                )
                for index, duration_s in enumerate(durations):
                    rows = [run[index] for run in runs]
                    levels = sorted(round(row.level_s, 2) for row in rows)
                    states = sorted({state for row in rows for state in row.states})
                    sys.stdout.write(
                        f"{airframe:10} {'+'.join(parts):30} {duration_s:4.1f} s"
                        f" lost {max(row.lost_m for row in rows):5.2f} m"
                        f" over {max(row.overshoot_m for row in rows):5.2f} m"
                        f" tilt {max(row.tilt_deg for row in rows):4.0f}° level after {levels}"
                        f" stopped {sum(row.motors_stopped for row in rows)}"
                        f" touched {sum(row.touched for row in rows)} {states}\n"
                    )
                    sys.stdout.flush()


if __name__ == "__main__":
    main()
