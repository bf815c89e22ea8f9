"""Simulation of one vehicle in its world, at a fixed sample rate."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

import msgspec

from swarmd.sim.config import BatteryConfig, Config, WindConfig
from swarmd.sim.core.contacts import Contacts, collision
from swarmd.sim.core.sensors import Gauss, SensorErrors, Uniform
from swarmware.errors import Denied, InvalidInput
from swarmware.geometry.attitude import Vector
from swarmware.geometry.world import World
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.navigation import Collision
from swarmware.types.vehicle import BatteryState, GnssFix, Imu, Pose, Range, Setpoint, VehicleState


class GustyWind:
    """Velocity of the air around one vehicle.

    Source: MIL-F-8785C, section 3.7 (Dryden form), with a time constant in place of length divided by speed,
    because a hovering vehicle has no speed.
    """

    __slots__ = ("_config", "_gauss", "_gust")

    def __init__(self, config: WindConfig, gauss: Callable[[float, float], float]) -> None:
        self._config = config
        self._gauss = gauss
        self._gust = [0.0, 0.0, 0.0]

    def __call__(self, dt_s: float) -> Vector:
        """Advances the wind by a duration; returns its velocity in the map."""
        config, gust = self._config, self._gust
        if config.gust_sigma_m_s > 0.0:
            correlation = math.exp(-dt_s / config.gust_tau_s)
            drive = config.gust_sigma_m_s * math.sqrt(1 - correlation**2)
            for axis in range(3):
                gust[axis] = gust[axis] * correlation + self._gauss(0.0, drive)
        x, y, z = config.mean_m_s
        return x + gust[0], y + gust[1], z + gust[2]


class Battery:
    """Energy store of one vehicle; the voltage is linear in the state of charge."""

    __slots__ = ("_config", "_energy_wh", "_power_w")

    def __init__(self, config: BatteryConfig) -> None:
        self._config = config
        self._energy_wh = config.capacity_wh * config.start_ratio
        self._power_w = 0.0

    @property
    def ratio(self) -> float:
        """State of charge, the ratio of remaining energy to capacity."""
        return self._energy_wh / self._config.capacity_wh

    @property
    def empty(self) -> bool:
        """True if the battery is empty, when the motors stop."""
        return self._energy_wh <= 0.0

    def draw(self, power_w: float, dt_s: float) -> None:
        """Draws power for the duration of a sample."""
        self._power_w = power_w
        # in Wh, hence the division by the seconds of an hour
        self._energy_wh = max(0.0, self._energy_wh - power_w * dt_s / 3600)

    def state(self) -> BatteryState:
        """The state that the battery monitor reports."""
        config = self._config
        voltage = config.voltage_empty_v + self.ratio * (config.voltage_full_v - config.voltage_empty_v)
        return BatteryState(round(voltage, 3), round(self._power_w / voltage, 3), round(self.ratio, 5))


if TYPE_CHECKING:
    from swarmd.sim.core.airframe_model import AirframeModel
    from swarmware.model.airframe import Airframe

BOUNDS: Final = "bounds"
GROUND: Final = "ground"
"""Names in a collision, in addition to the names of obstacles and platforms."""

_STEPS_PER_SAMPLE: Final = 2
"""Integration steps per inertial sample of an airframe; each step takes the newest outputs."""
_SCANNER_M: Final = 0.3
"""Height of the scanner of a ground vehicle above the ground."""
_BATTERY_HZ: Final = 1.0
_RELEASE_M: Final = 0.1
"""Distance at which a contact ends."""


Command = Setpoint | ActuatorOutputs
"""Command to a vehicle: a set-point if the model includes controllers, else outputs of a flight
controller."""
C_contra = TypeVar("C_contra", Setpoint, ActuatorOutputs, contravariant=True)


class VehicleModel(Protocol[C_contra]):
    """Interface of a vehicle model."""

    armed: bool

    @property
    def safe(self) -> Command:
        """Command in force without a fresh command."""
        ...

    @property
    def stall_s(self) -> float:
        """Maximum stall of the computer that is simulated afterwards; the rest is skipped."""
        ...

    @property
    def flies(self) -> bool: ...
    @property
    def landed(self) -> bool: ...
    @property
    def radius_m(self) -> float: ...
    def step(self, wanted: C_contra, dt_s: float, /) -> float: ...
    def stop_at(self, x_m: float, y_m: float, z_m: float) -> None: ...
    def pose(self) -> Pose: ...
    def rates(self) -> Vector: ...
    def specific_force(self) -> Vector: ...
    def power_w(self) -> float: ...


class SimulationOutput(msgspec.Struct, frozen=True, gc=False):
    """Outputs of one call of `advance`: the true pose, and the due measurements."""

    stamp_ns: int
    """Instant of all values."""
    truth: Pose
    gnss: GnssFix | None = None
    imu: Imu | None = None
    scan: Range | None = None
    sonar: Range | None = None
    battery: BatteryState | None = None
    report: ChassisReport | None = None
    """Report of the chassis, set at changes and once a second."""
    collisions: tuple[Collision, ...] = ()


class _SamplePeriods(msgspec.Struct, frozen=True):
    """Period of each output in integration steps."""

    gnss: int
    imu: int
    scan: int
    battery: int
    sonar: int | None
    """Period of the sonar, or None for a vehicle that does not fly."""

    def all(self) -> list[int]:
        """All periods, without a missing sonar."""
        some = [self.gnss, self.imu, self.scan, self.battery]
        return some if self.sonar is None else [*some, self.sonar]

    def next_after(self, steps: int) -> int:
        """The next step at which any output is due."""
        return min((steps // period + 1) * period for period in self.all())

    def not_faster(self, steps: int) -> "_SamplePeriods":
        """Copies the periods, with a minimum of `steps` for each."""
        return _SamplePeriods(
            max(self.gnss, steps),
            max(self.imu, steps),
            max(self.scan, steps),
            max(self.battery, steps),
            None if self.sonar is None else max(self.sonar, steps),
        )


class Simulation:
    """Simulates a vehicle, its battery, its sensors and its collisions.

    Samples are at multiples of their periods, independent of the lateness of the calls, like the reads of the
    drivers. `advance` is called when a sensor is due, and integrates the steps since the last call.
    """

    def __init__(
        self,
        config: Config,
        world: World,
        kind: PlatformKind,
        start: Pose,
        gauss: Gauss,
        uniform: Uniform,
        airframe: "Airframe | None" = None,
    ) -> None:
        """`airframe`: airframe that a flight controller flies, or None if the model follows set-points."""
        self._config = config
        self._world = world
        # the airframe decides whether model and driver use set-points or outputs
        self.vehicle: VehicleModel[Any] = (
            model(config, kind, start) if airframe is None else flying_body(airframe, config, start, gauss)
        )
        self._battery = Battery(
            config.battery
            if airframe is None
            else msgspec.structs.replace(config.battery, capacity_wh=airframe.battery_wh)
        )
        self._sensors = SensorErrors(config.sensors, world, gauss, uniform)
        self._rate_hz = config.rate_hz if airframe is None else _STEPS_PER_SAMPLE * airframe.control_hz
        self._dt_ns = round(1e9 / self._rate_hz)
        self._dt_s = self._dt_ns / 1e9
        held_s = config.setpoint_timeout_s if airframe is None else airframe.body.outputs_held_s
        self._held_ns = round(held_s * 1e9)
        """Age of a command above which the safe command is in force."""
        self._begun = False
        self._steps = 0
        """Index of the current step, which is its instant in steps."""
        self._command: Command = self.vehicle.safe
        self._command_ns = 0
        self._next_command: tuple[Command, int] | None = None
        """The newest command and its instant, in force from the next step after the instant."""
        self._answer = (0, "")
        """Number of the newest answered order, and the reason if it was refused."""
        self._published: ChassisReport | None = None
        self._touched: frozenset[str] = frozenset()
        self._parked: Pose | None = None
        """Pose of a vehicle at rest with its motors off, which needs no integration, else None."""
        self._contacts = Contacts(self.vehicle.radius_m)
        rates = config.sensors
        self._moving = _SamplePeriods(
            self._every(rates.gnss_hz),
            self._every(rates.imu_hz if airframe is None else airframe.control_hz),
            self._every(rates.range_hz),
            self._every(_BATTERY_HZ),
            self._every(rates.sonar_hz) if self.vehicle.flies else None,
        )
        self._resting = self._moving.not_faster(self._every(rates.rest_hz))
        self._due_after = (-1, self._moving, 0)
        """Cached deadline: a step, the periods, and the instant of the next sample for both."""
        self._every_contact = self._every(config.contacts_hz)
        self.output_hz = self._rate_hz / min(self._moving.all())
        """Rate of the true pose, which is published with the fastest sensor."""
        self.imu_hz = self._rate_hz / self._moving.imu
        """Rate of the inertial unit."""

    def _every(self, rate_hz: float) -> int:
        return max(1, round(self._rate_hz / rate_hz))

    def state(self) -> VehicleState:
        """State of the vehicle with armed and landed."""
        return VehicleState(self.vehicle.armed, self.vehicle.landed)

    def report(self) -> ChassisReport:
        """Report of the chassis with armed, landed and the answer to the newest order."""
        return ChassisReport(self.vehicle.armed, self.vehicle.landed, *self._answer)

    def on_command(self, command: Command, stamp_ns: int) -> None:
        """Takes a command of the driver, a set-point or outputs for an airframe."""
        if self._next_command is not None:
            self._command, self._command_ns = self._next_command
        self._next_command = (command, stamp_ns)

    def on_order(self, order: ChassisOrder) -> ChassisReport:
        """Executes an order unless it was answered before; returns the report, with the reason of a
        refusal."""
        if order.number > self._answer[0]:
            refusal = ""
            try:
                self._execute(order)
            except Denied as error:
                refusal = str(error)
            self._answer = (order.number, refusal)
        return self.report()

    def _execute(self, order: ChassisOrder) -> None:
        match order.action:
            case ChassisAction.ARM:
                self.on_arm(True)
            case ChassisAction.DISARM:
                self.on_arm(False)
            case ChassisAction.KILL:
                self.on_kill()
            case ChassisAction.CALIBRATE:
                if not self.state().resting:
                    raise Denied("calibration: expected a vehicle that is disarmed and on the ground")
            case _:
                raise Denied(f"{order.action}: not supported by the simulated chassis")

    def on_arm(self, armed: bool) -> VehicleState:
        """Arms or disarms the motors.

        Raises: Denied with the reason.
        """
        vehicle, min_ratio = self.vehicle, self._config.battery.arm_ratio
        if armed and not vehicle.armed and self._battery.ratio < min_ratio:
            raise Denied(f"arming: battery at {self._battery.ratio:.0%}, expected at least {min_ratio:.0%}")
        if armed and not vehicle.armed and vehicle.flies and not vehicle.landed:
            raise Denied(f"arming in the air at {vehicle.pose().z_m:.1f} m: expected a landed vehicle")
        if not armed and vehicle.flies and not vehicle.landed:
            raise Denied(f"disarming in the air at {vehicle.pose().z_m:.1f} m: expected a landed vehicle")
        vehicle.armed = armed
        return self.state()

    def on_kill(self) -> VehicleState:
        """Stops the motors; a vehicle in the air falls."""
        self.vehicle.armed = False
        return self.state()

    def on_neighbour(self, platform: str, pose: Pose, stamp_ns: int) -> None:
        """Takes the pose of another platform, stamped in the own clock."""
        self._contacts.on_neighbour(platform, pose, stamp_ns)

    def is_clear(self, platform: str, now_ns: int) -> bool:
        """True if a platform is so far away that a contact is not yet possible."""
        return self._contacts.is_clear(platform, now_ns)

    def advance(self, now_ns: int) -> SimulationOutput | None:
        """Simulates all samples up to now; returns their outputs, or None if no sample is due."""
        reached = now_ns // self._dt_ns
        if not self._begun:
            self._begun = True
            self._steps = reached - 1
        due = reached - self._steps
        if due <= 0:
            return None
        # catching up after a stall is limited, because it would cause another stall
        simulated = min(due, round(self.vehicle.stall_s / self._dt_s))
        first = self._steps
        hits: list[Collision] = []
        if self._is_parked():
            hits += self._stay(simulated)
        else:
            for _ in range(simulated):
                hits += self._step()
        # the skipped steps of a long stall
        self._steps += due - simulated
        return self._sample(first, tuple(hits))

    def deadline_ns(self) -> int | None:
        """Instant of the next sample, or None before the first call of `advance`."""
        if not self._begun:
            return None
        # cached, because the deadline is asked for after each event
        periods = self._periods()
        if self._due_after[0] != self._steps or self._due_after[1] is not periods:
            self._due_after = (self._steps, periods, periods.next_after(self._steps) * self._dt_ns)
        return self._due_after[2]

    def _periods(self) -> _SamplePeriods:
        vehicle = self.vehicle
        return self._resting if vehicle.landed and not vehicle.armed else self._moving

    def _is_parked(self) -> bool:
        vehicle = self.vehicle
        return self._parked is not None and not vehicle.armed and vehicle.pose() == self._parked

    def _stamp_ns(self) -> int:
        return self._steps * self._dt_ns

    def _stay(self, count: int) -> list[Collision]:
        """Simulates several samples of a parked vehicle in one step."""
        # the battery is the only state of a parked vehicle that changes
        first, self._steps = self._steps, self._steps + count
        vehicle = self.vehicle
        self._battery.draw(vehicle.power_w(), count * self._dt_s)
        if self._contacts and self._steps // self._every_contact > first // self._every_contact:
            return self._touching(vehicle.pose(), 0.0, self._stamp_ns())
        return []

    def _step(self) -> list[Collision]:
        self._steps += 1
        stamp_ns = self._stamp_ns()
        vehicle = self.vehicle
        # an empty battery stops the motors, also in the air
        if self._battery.empty:
            vehicle.armed = False
        # a command is in force from its own instant on, however late the simulation catches up
        if self._next_command is not None and self._next_command[1] < stamp_ns:
            self._command, self._command_ns = self._next_command
            self._next_command = None
        old = stamp_ns - self._command_ns > self._held_ns
        before = vehicle.pose()
        impact_m_s = vehicle.step(vehicle.safe if old else self._command, self._dt_s)
        self._battery.draw(vehicle.power_w(), self._dt_s)
        pose = vehicle.pose()
        speed = math.hypot(before.vx_m_s, before.vy_m_s, before.vz_m_s)
        hits = [collision(GROUND, pose, impact_m_s)] if impact_m_s > 0.0 else []
        # a parked vehicle is not integrated, which saves processor time
        self._parked = pose if pose == before and not vehicle.armed else None
        if pose.x_m != before.x_m or pose.y_m != before.y_m or pose.z_m != before.z_m:
            hits += self._obstacles(before, pose, speed)
        if self._contacts and self._steps % self._every_contact == 0:
            hits += self._touching(pose, speed, stamp_ns)
        return hits

    def _obstacles(self, before: Pose, pose: Pose, speed_m_s: float) -> list[Collision]:
        radius = self.vehicle.radius_m
        found = self._world.touching(pose.x_m, pose.y_m, pose.z_m, radius)
        inside = self._world.bounds.contains(pose.x_m, pose.y_m, pose.z_m)
        now = frozenset(({found.name} if found else set()) | (set() if inside else {BOUNDS}))
        if self._touched:
            # a vehicle pressed against an obstacle oscillates by millimetres, which is still one contact
            near = self._world.touching(pose.x_m, pose.y_m, pose.z_m, radius + _RELEASE_M)
            now |= self._touched & {near.name if near else ""}
        new, self._touched = now - self._touched, now
        if found is not None and found.distance_m(pose.x_m, pose.y_m) < found.distance_m(
            before.x_m, before.y_m
        ):
            # obstacles are rigid, so a vehicle in contact may only move away
            self.vehicle.stop_at(before.x_m, before.y_m, before.z_m)
        return [collision(name, pose, speed_m_s) for name in sorted(new)]

    def _touching(self, pose: Pose, speed_m_s: float, stamp_ns: int) -> list[Collision]:
        return [collision(platform, pose, speed_m_s) for platform in self._contacts.check(pose, stamp_ns)]

    def _sample(self, first: int, hits: tuple[Collision, ...]) -> SimulationOutput:
        def due(every: int) -> bool:
            return self._steps // every > first // every

        vehicle, sensors, periods = self.vehicle, self._sensors, self._periods()
        pose = vehicle.pose()
        report = self.report()
        publish = report != self._published or due(periods.battery)
        self._published = report
        return SimulationOutput(
            self._stamp_ns(),
            pose,
            sensors.gnss(pose, periods.gnss * self._dt_s) if due(periods.gnss) else None,
            sensors.imu(pose, vehicle.rates(), vehicle.specific_force()) if due(periods.imu) else None,
            sensors.scan(pose, max(pose.z_m, _SCANNER_M)) if due(periods.scan) else None,
            sensors.sonar(pose.z_m) if periods.sonar is not None and due(periods.sonar) else None,
            self._battery.state() if due(periods.battery) else None,
            report if publish else None,
            hits,
        )


def flying_body(
    airframe: "Airframe", config: Config, start: Pose, gauss: Gauss
) -> VehicleModel[ActuatorOutputs]:
    """Creates the vehicle model of an airframe."""
    from swarmd.sim.core.fixed_wing_airframe import FixedWing  # not loaded by most vehicles
    from swarmd.sim.core.flying_body import FlyingBody
    from swarmd.sim.core.helicopter_airframe import HelicopterRotors
    from swarmd.sim.core.multirotor_airframe import MultirotorRotors

    model: AirframeModel
    match airframe.type:
        case "multirotor":
            model = MultirotorRotors(airframe)
        case "helicopter":
            model = HelicopterRotors(airframe)
        case _:
            model = FixedWing(airframe)
    return FlyingBody(model, airframe.body, start, GustyWind(config.wind, gauss))


def model(config: Config, kind: PlatformKind, start: Pose) -> VehicleModel[Setpoint]:
    """Creates the model of a kind of platform: uav multirotor, ugv ground vehicle, usv surface vessel.

    Raises: InvalidInput for a kind without a vehicle, such as gcs.
    """
    match kind:
        case PlatformKind.UAV:
            from swarmd.sim.core.multirotor import Multirotor  # each kind loads its own model only

            return Multirotor(config.multirotor, start)
        case PlatformKind.UGV:
            from swarmd.sim.core.ground import Ground

            return Ground(config.ground, start)
        case PlatformKind.USV:
            from swarmd.sim.core.surface import Surface

            return Surface(config.surface, start)
        case _:
            raise InvalidInput(f"kind {kind!r}: nothing to simulate; expected uav, ugv or usv")
