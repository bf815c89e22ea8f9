"""The simulation's shell: set-points in, truth and sensors out, at fixed instants."""

import random
import re
from typing import ClassVar, Final

from swarmd.sim import config as settings
from swarmd.sim.core.simulation import Simulation, SimulationOutput
from swarmd.sim.motors import Motors
from swarmware.geometry.world import World
from swarmware.model.config import load
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.runtime.instant import until
from swarmware.service.service import Service
from swarmware.types.vehicle import (
    BatteryState,
    Collision,
    GnssFix,
    Imu,
    MotorOrder,
    Pose,
    Range,
    Setpoint,
    VehicleState,
)

_RESUME_S: Final = 10.0
"""Longest interruption of the simulation after which the vehicle continues at its last pose."""
_LOOK_S: Final = 1.0
"""Period of looking for new platforms, in seconds."""


class Sim(Service):
    """Simulates the vehicle of the platform and its sensors."""

    name = "sim"
    Config: ClassVar = settings.Config
    config: settings.Config

    async def run(self) -> None:
        """Samples until the service ends."""
        module, node = self.module, self.module.node
        world = load(node.config.share_path / "worlds" / f"{self.config.world}.toml", World)
        kind = node.config.kind
        chance = random.Random(f"{self.config.seed} {module.platform}")
        jitter = (chance.uniform(-1, 1), chance.uniform(-1, 1))
        start = world.start_pose(kind, self.config.number or number_in(module.platform), jitter)
        last = self._last(start)
        simulation = Simulation(self.config, world, kind, last[0], chance.gauss, chance.random)
        simulation.vehicle.armed = last[1]
        outputs = Outputs(module, self.config, flies=simulation.vehicle.flies, output_hz=simulation.output_hz)
        outputs.open()

        Motors(module, simulation, outputs.vehicle, outputs.orders).serve()
        await self._loop(simulation, outputs)

    def _last(self, start: Pose) -> tuple[Pose, bool]:
        """Last pose and arming after a short interruption; else the start pose, disarmed."""
        truth = self.module.reader("sim/truth", Pose)
        vehicle = self.module.reader("vehicle/state", VehicleState)
        try:
            pose, age_s, state = truth.value, truth.age_s, vehicle.value
            if pose is None or age_s is None or not 0 <= age_s < _RESUME_S:
                return start, False
            self.module.log.warning("resumed at %.2f, %.2f, %.2f m", pose.x_m, pose.y_m, pose.z_m)
            return pose, state is not None and state.armed
        finally:
            truth.close()
            vehicle.close()

    async def _loop(self, simulation: Simulation, outputs: "Outputs") -> None:
        now_ns = self.module.now_ns
        setpoint = self.module.reader("act/setpoint", Setpoint)
        poses = self.module.readers("/*/nav/pose", Pose)
        others: dict[str, BoardReader[Pose]] = {}
        taken: dict[str, Pose] = {}
        seen: Setpoint | None = None
        look_ns = near_ns = 0
        while True:
            begin_ns = now_ns()
            wanted = setpoint.value
            if wanted is not None and wanted is not seen:
                seen = wanted
                simulation.on_setpoint(wanted, setpoint.stamp_ns or begin_ns)
            if begin_ns >= near_ns:
                near_ns = begin_ns + round(1e9 / self.config.contacts_hz)
                if begin_ns >= look_ns:
                    look_ns = begin_ns + round(_LOOK_S * 1e9)
                    others = dict(poses)
                for platform, reader in others.items():
                    pose = reader.value
                    if pose is None or pose is taken.get(platform) or (age_s := reader.age_s) is None:
                        continue
                    taken[platform] = pose
                    simulation.on_neighbour(platform, pose, begin_ns - round(age_s * 1e9))
            sample = simulation.on_timer(begin_ns)
            if sample is not None:
                outputs.write(sample)
                for hit in sample.collisions:
                    self.module.log.warning("collision with %s at %.2f m/s", hit.other, hit.speed_m_s)
            due_ns = simulation.deadline_ns()
            await until(self.module.clock, due_ns or begin_ns)


class Outputs:
    """The writers of the simulation."""

    def __init__(self, module: Module, config: settings.Config, *, flies: bool, output_hz: float) -> None:
        self._module = module
        self._config = config
        self._flies = flies
        self._output_hz = output_hz
        self._sonar: BoardWriter[Range] | None = None

    def open(self) -> None:
        """Open the writers of truth, sensors and events."""
        writer, rates = self._module.writer, self._config.sensors
        self._truth = writer(
            "sim/truth", Pose, rate_hz=self._output_hz, description="True pose of the vehicle"
        )
        self.vehicle = writer("vehicle/state", VehicleState, description="Armed, landed")
        self._gnss = writer("sim/sensors/gnss", GnssFix, rate_hz=rates.gnss_hz)
        self._imu = writer("sim/sensors/imu", Imu, rate_hz=rates.imu_hz)
        self._scan = writer("sim/sensors/range", Range, rate_hz=rates.range_hz)
        self._battery = writer("sim/sensors/battery", BatteryState, rate_hz=1.0)
        if self._flies:
            self._sonar = writer("sim/sensors/sonar", Range, rate_hz=rates.sonar_hz)
        self._collision = self._module.stream_writer(
            "sim/collision", Collision, kind="event", description="Collision of the vehicle"
        )
        self.orders = self._module.stream_writer(
            "vehicle/orders",
            MotorOrder,
            kind="event",
            log="all",
            description="Audit log: each request to the motors, with its sender",
        )

    def write(self, sample: SimulationOutput) -> None:
        """Publishes the outputs of a sample, stamped with its instant."""
        stamp_ns = sample.stamp_ns
        self._truth.write(sample.truth, stamp_ns)
        if sample.imu is not None:
            self._imu.write(sample.imu, stamp_ns)
        if sample.gnss is not None:
            self._gnss.write(sample.gnss, stamp_ns)
        if sample.scan is not None:
            self._scan.write(sample.scan, stamp_ns)
        if sample.sonar is not None and self._sonar is not None:
            self._sonar.write(sample.sonar, stamp_ns)
        if sample.battery is not None:
            self._battery.write(sample.battery, stamp_ns)
        if sample.vehicle is not None:
            self.vehicle.write(sample.vehicle, stamp_ns)
        for hit in sample.collisions:
            self._collision.write(hit, stamp_ns)


def number_in(platform: str) -> int:
    """Number at the end of a platform's name; 1 when it has none."""
    found = re.search(r"[0-9]+$", platform)
    return max(1, int(found[0])) if found else 1
