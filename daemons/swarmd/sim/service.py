"""The simulation's shell, which reads set-points or outputs, and publishes truth and sensors."""

import random
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final

from swarmd.sim import config as settings
from swarmd.sim.core.simulation import Command, Simulation, SimulationOutput
from swarmd.sim.core.vehicle_core import Action, PublishOutput, PublishReport, ReadBoards, VehicleCore
from swarmd.sim.switch import Switch
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.service.service import Service
from swarmware.types.chassis import ActuatorOutputs, ChassisOrder, ChassisReport
from swarmware.types.navigation import Collision
from swarmware.types.vehicle import BatteryState, GnssFix, Imu, Pose, Range, Setpoint


class ChassisPort:
    """Executes orders of the driver as soon as they are written."""

    def __init__(self, module: Module, core: VehicleCore, feed: Callable[[Iterable[Action]], None]) -> None:
        self._module = module
        self._core = core
        self._feed = feed
        # orders from before this start are skipped, because the driver repeats unanswered orders
        self._orders = module.stream_reader(paths.SIM_ORDERS, ChassisOrder)

    def serve(self) -> None:
        """Starts to execute orders."""
        # a task and not the timer of the core, because a kill must act at once
        self._module.start(self._follow(), "orders to the chassis")

    async def _follow(self) -> None:
        async for order in self._orders:
            self._feed(self._core.on_order(order, self._module.now_ns()))


if TYPE_CHECKING:
    from swarmd.sim.pulse_inputs import PulseInputs
    from swarmd.sim.serial_ports import SerialPorts

_RESUME_S: Final = 10.0
"""Maximum interruption of the simulation after which the vehicle continues at its last pose."""
_LOOK_S: Final = 1.0
"""Period of the search for new platforms."""


class Sim(Service):
    """Simulates the vehicle of the platform and its sensors."""

    name = "sim"
    Config: ClassVar = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node
        world = load(paths.world(node.config.share_path, config.world), World)
        # each platform has its own noise, and repeats it with the same seed
        chance = random.Random(f"{config.seed} {module.platform}")
        jitter = (chance.uniform(-1, 1), chance.uniform(-1, 1))
        start = world.start_pose(node.config.kind, config.number or number_in(module.platform), jitter)
        pose, armed = self._last(start)
        airframe = None
        if node.config.airframe:
            from swarmware.model.airframe_file import load_airframe  # not loaded by most vehicles

            airframe = load_airframe(node.config.share_path, node.config.airframe)
        simulation = Simulation(config, world, node.config.kind, pose, chance.gauss, chance.random, airframe)
        simulation.vehicle.armed = armed
        self._core = VehicleCore(config, simulation)
        self._driver = self.drive(self._core, self._perform)
        self._outputs = Outputs(module, config, simulation)
        self._port = ChassisPort(module, self._core, self._driver.feed)
        self._switch = Switch(module, published=not config.serial.folder)
        self._serial: SerialPorts | None = None
        self._pulses: PulseInputs | None = None
        if config.serial.folder:
            from swarmd.sim import serial_ports  # loads the protocols of all devices
            from swarmd.sim.core.serial_devices import SerialDevices

            folder = Path(config.serial.folder)
            if airframe is not None:
                from swarmd.sim import pulse_inputs

                self._pulses = pulse_inputs.PulseInputs(folder, airframe)
                simulation.vehicle.armed = (
                    True  # motors follow their pulses, so the driver of the pulses decides about arming
                )
            devices = SerialDevices(config.setpoint_timeout_s, chassis=airframe is None)
            self._serial = serial_ports.SerialPorts(module, folder, devices, self._on_serial)
        self._commands: BoardReader[Setpoint] | BoardReader[ActuatorOutputs] = (
            module.reader(paths.SIM_OUTPUTS, ActuatorOutputs)
            if airframe is not None
            else module.reader(paths.SIM_SETPOINT, Setpoint)
        )
        self._taken: Command | None = None
        """The newest command that was passed to the simulation."""
        self._poses = module.readers("/*/nav/pose", Pose)
        self._neighbours: dict[str, BoardReader[Pose]] = {}
        self._taken_poses: dict[str, Pose] = {}
        """The newest pose of each neighbour that was passed to the simulation."""
        self._look_ns = 0

    async def run(self) -> None:
        """Runs the simulation until the service ends."""
        self._port.serve()
        self._switch.serve()
        try:
            await self._driver.run()
        finally:
            if self._serial is not None:
                self._serial.close()
            if self._pulses is not None:
                self._pulses.close()

    def _last(self, start: Pose) -> tuple[Pose, bool]:
        """Last pose and arming after a short interruption, else the start pose, disarmed."""
        truth = self.module.reader("sim/truth", Pose)
        report = self.module.reader(paths.SIM_REPORT, ChassisReport)
        try:
            pose, age_s, last = truth.value, truth.age_s, report.value
            # after a longer interruption the vehicle starts again
            if pose is None or age_s is None or not 0 <= age_s < _RESUME_S:
                return start, False
            self.module.log.warning("resumed at %.2f, %.2f, %.2f m", pose.x_m, pose.y_m, pose.z_m)
            return pose, last is not None and last.armed
        finally:
            truth.close()
            report.close()

    def _perform(self, action: Action) -> None:
        match action:
            case ReadBoards(neighbours):
                self._read(neighbours, self.module.now_ns())
            case PublishOutput(output):
                self._outputs.write(output)
                if self._serial is not None:
                    self._serial.on_output(output, self._switch.mode)
                for hit in output.collisions:
                    self.module.log.warning("collision with %s at %.2f m/s", hit.other, hit.speed_m_s)
            case PublishReport(report):
                self._outputs.report.write(report)
                if self._serial is not None:
                    self._serial.on_report(report)

    def _on_serial(self, received: Setpoint | ChassisOrder) -> None:
        """Takes a set-point or order that the driver of the chassis sent on its line."""
        now_ns = self.module.now_ns()
        if isinstance(received, Setpoint):
            self._driver.feed(self._core.on_command(received, now_ns, now_ns))
        else:
            self._driver.feed(self._core.on_order(received, now_ns))

    def _read(self, neighbours: bool, now_ns: int) -> None:
        core, feed = self._core, self._driver.feed
        if self._pulses is not None:
            feed(core.on_command(self._pulses.outputs(), now_ns, now_ns))
        command = self._commands.value
        if self._pulses is None and command is not None and command is not self._taken:
            self._taken = command
            feed(core.on_command(command, self._commands.local_stamp_ns or now_ns, now_ns))
        if neighbours:
            if now_ns >= self._look_ns:
                self._look_ns = now_ns + round(_LOOK_S * 1e9)
                self._neighbours = dict(self._poses)
            for platform, reader in self._neighbours.items():
                if core.is_clear(platform, now_ns):
                    continue
                pose = reader.value
                # the identity of the value distinguishes a new pose from a repeated read
                if pose is None or pose is self._taken_poses.get(platform):
                    continue
                if (age_s := reader.age_s) is not None:
                    self._taken_poses[platform] = pose
                    feed(core.on_neighbour(platform, pose, now_ns - round(age_s * 1e9), now_ns))
        feed(core.on_boards_read(now_ns))


class Outputs:
    """Writers of the simulation's boards."""

    def __init__(self, module: Module, config: settings.Config, simulation: Simulation) -> None:
        writer, rates = module.writer, config.sensors
        self._truth = writer(
            "sim/truth", Pose, rate_hz=simulation.output_hz, description="True pose of the vehicle"
        )
        self.report = writer(paths.SIM_REPORT, ChassisReport)
        self._gnss = writer("sim/sensors/gnss", GnssFix, rate_hz=rates.gnss_hz)
        self._imu = writer("sim/sensors/imu", Imu, rate_hz=simulation.imu_hz)
        self._scan = writer("sim/sensors/range", Range, rate_hz=rates.range_hz)
        self._battery = writer("sim/sensors/battery", BatteryState, rate_hz=1.0)
        self._sonar: BoardWriter[Range] | None = None
        if simulation.vehicle.flies:
            self._sonar = writer("sim/sensors/sonar", Range, rate_hz=rates.sonar_hz)
        self._collision = module.stream_writer(
            "sim/collision", Collision, kind="event", description="Collision of the vehicle"
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
        if sample.report is not None:
            self.report.write(sample.report, stamp_ns)
        for hit in sample.collisions:
            self._collision.write(hit, stamp_ns)


def number_in(platform: str) -> int:
    """Number at the end of a platform's name, or 1 without a number."""
    found = re.search(r"[0-9]+$", platform)
    return max(1, int(found[0])) if found else 1
