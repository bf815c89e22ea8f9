"""Base of the drivers of airframes without attitude control, which run the control law themselves."""

import logging
from abc import abstractmethod
from collections.abc import Sequence
from typing import Final

import msgspec

from swarmd.hal.chassis import Chassis
from swarmd.hal.config import ChassisConfig
from swarmd.hal.core.condition import Condition
from swarmd.hal.core.flight.control_law import ControlLaw
from swarmd.hal.core.flight.flight_core import FALL_MAX_S, FlightCore, FlightHandover, FlightTiming
from swarmd.hal.core.flight.flight_recorder import FlightRecorder
from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.errors import Denied
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.streamwriter import StreamWriter
from swarmware.module.writer import BoardWriter
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.flight_record import FlightRecord, FlightRecordRow
from swarmware.types.scalar import Float
from swarmware.types.vehicle import GnssFix, Imu, Pose, Setpoint, VehicleState

_RECORDS: Final = 4
"""Number of records that stay readable, for the logger, which reads them at once."""
_RECORD_BYTES: Final = 16_384
"""Maximum size of a record, for 100 rows of an airframe with eight motors."""

log = logging.getLogger("swarm.hal")


class FlightController(Chassis):
    """Base of the drivers of airframes, which differ only in the connection to their actuators.

    `write` is called at the rate of the inertial unit, and reads the samples from the board `imu`. Their mean
    is published in `sensor/imu` at `imu_hz`, with the attitude of the filter. Fixes and the sonar's height
    come from the boards of their drivers. A driver implements `send_outputs` and `carry_order`, and passes
    each report of the device to `on_report`. A process that is restarted within seconds continues the flight
    of the previous process, while the actuators hold their last outputs (ADR 69).
    """

    def __init__(
        self,
        name: str,
        config: ChassisConfig,
        controller: ControlLaw,
        timing: FlightTiming,
        imu: str,
        imu_hz: float,
    ) -> None:
        # set-points are read at the rate of control
        super().__init__(name, msgspec.structs.replace(config, rate_hz=1 / timing.period_s))
        self._timing = timing
        self._flight = FlightCore(controller, timing, config.origin_acc_m)
        self._source = imu
        self._imu_hz = imu_hz
        self._imu_ns = 0
        """Instant of the last publication of the mean."""
        self._imu: BoardReader[Imu] | None = None
        self._gnss: BoardReader[GnssFix] | None = None
        self._height: BoardReader[Float] | None = None
        self._taken_height: Float | None = None
        self._mean: BoardWriter[Imu] | None = None
        self._recorder = FlightRecorder()
        self._records: StreamWriter[FlightRecord] | None = None

    @property
    def flight_state(self) -> FlightState:
        """Estimated state at the newest inertial sample."""
        return self._flight.state()

    @abstractmethod
    def send_outputs(self, outputs: ActuatorOutputs, stamp_ns: int) -> None:
        """Sends outputs to the actuators."""

    @abstractmethod
    def carry_order(self, order: ChassisOrder) -> None:
        """Sends an order to the device, for the first time or again."""

    def take_over(self, module: Module) -> bool:
        """Continues the flight of a process that has just ended, from its boards; returns False without a
        flight."""
        state, imu = module.reader("vehicle/state", VehicleState), module.reader("sensor/imu", Imu)
        pose = module.reader("nav/pose", Pose)
        try:
            vehicle, sample, age_s, place = state.value, imu.value, imu.age_s, pose.value
            flies = vehicle is not None and vehicle.armed and not vehicle.landed
            # an older flight has ended on the ground, whatever the boards say
            if not flies or sample is None or age_s is None or age_s > self._timing.held_s + FALL_MAX_S:
                return False
            handover = FlightHandover(sample, imu.local_stamp_ns or module.now_ns())
            if place is not None:
                velocity = (place.vx_m_s, place.vy_m_s, place.vz_m_s)
                handover = FlightHandover(sample, handover.stamp_ns, place.z_m, velocity)
        finally:
            for reader in (state, imu, pose):
                reader.close()
        log.warning("driver %s: the vehicle is in flight; taken over after %.2f s", self.name, age_s)
        self._flight.on_handover(handover)
        return True

    async def open(self, module: Module) -> None:
        """Opens the boards of the sensors."""
        await super().open(module)
        self._imu = module.reader(self._source, Imu)
        self._gnss = module.reader("sensor/gnss", GnssFix)
        self._height = module.reader("sensor/height", Float)
        self._mean = self.managed(module, module.writer("sensor/imu", Imu, rate_hz=self._imu_hz))
        records = module.stream_writer(
            "vehicle/flight_record",
            FlightRecord,
            kind="event",
            log="all",
            slots=_RECORDS,
            slot_bytes=_RECORD_BYTES,
            description="The seconds around a fault of the flight, at 20 Hz",
        )
        self._records = self.managed(module, records)

    async def close(self) -> None:
        """Closes the boards; in flight, the boards by which the next process continues the flight stay
        readable."""
        state = self.state
        if state is not None and state.armed and not state.landed:
            # durable boards stay in shared memory after their writer has closed
            for writer in (self._state, self._mean):
                if writer is not None:
                    writer.durable = True
        await super().close()
        for reader in (self._imu, self._gnss, self._height):
            if reader is not None:
                reader.close()
        self._imu = self._gnss = self._height = self._mean = self._records = None

    async def write(self, now_ns: int) -> bool:
        """Runs filters and control law for the newest inertial sample; returns False without a new sample.

        Raises: DeviceError when the device has not reported for too long.
        """
        await super().write(now_ns)
        self._read(now_ns)
        outputs = self._flight.step(now_ns)
        if outputs is None:
            return False
        self.send_outputs(outputs, now_ns)
        self._record(outputs, now_ns)
        self._publish_imu(now_ns)
        # once: the order is repeated until the device answers it
        if self._flight.lost and not self._core.killing:
            log.error("driver %s: the motors are stopped: %s", self.name, self._flight.lost)
            # a flight that cannot be continued ends here, before the motors start again in an unknown
            # attitude
            self.carry_order(self._core.on_order(ChassisAction.KILL, now_ns))
        return True

    def _record(self, outputs: ActuatorOutputs, now_ns: int) -> None:
        """Keeps the step for a record, and publishes the record of a fault when it is complete."""
        recorder, flight, chassis = self._recorder, self._flight, self.state
        if chassis is not None and chassis.armed:
            state = flight.state()
            height_m, climb_m_s = state.position_m[2], state.velocity_m_s[2]
            recorder.on_step(
                FlightRecordRow(
                    now_ns,
                    flight.gap_s,
                    state.roll_rad,
                    state.pitch_rad,
                    height_m,
                    climb_m_s,
                    outputs.motors,
                )
            )
        if self._records is not None and (record := recorder.take(now_ns)) is not None:
            self._records.write(record)

    def conditions(self, now_ns: int) -> Sequence[Condition]:
        """Changed faults of the flight in loop, tilt and contact; an error causes a record."""
        found = self._flight.watch.conditions(now_ns)
        for one in found:
            if one.level == "error":
                self._recorder.on_fault(f"{one.name} {one.state}", now_ns)
        return found

    def _read(self, now_ns: int) -> None:
        flight, gnss, height, imu = self._flight, self._gnss, self._height, self._imu
        if gnss is not None and (fix := gnss.value) is not None:
            flight.on_gnss(fix, gnss.local_stamp_ns or now_ns, now_ns)
        # taken once: the same height again would count as a second measurement
        if height is not None and (found := height.value) is not None and found is not self._taken_height:
            self._taken_height = found
            flight.on_height(found.value)
        if imu is not None and (sample := imu.value) is not None:
            flight.on_imu(self.corrected(sample), imu.local_stamp_ns or now_ns)

    def corrected(self, imu: Imu) -> Imu:
        """The sample unchanged, because the driver of the inertial unit has corrected it."""
        return imu

    def _publish_imu(self, now_ns: int) -> None:
        # half a control period early, since the instants of both rates differ
        if self._mean is None or now_ns - self._imu_ns < 1e9 / self._imu_hz - self.period_s / 2 * 1e9:
            return
        mean = self._flight.take_imu()
        if mean is not None:
            self._imu_ns = now_ns
            self._mean.write(mean, self._flight.imu_ns)

    def failsafe(self, now_ns: int) -> str:
        """Reason of the fail-safe, including missing inertial samples, or "" without a fail-safe."""
        state = self.state
        if state is not None and state.armed and self._flight.is_blind(now_ns):
            return f"no inertial samples in {self._source}: the attitude is not known"
        return super().failsafe(now_ns)

    def on_report(self, report: ChassisReport, stamp_ns: int) -> None:
        """Takes a report of the device, with the states armed and landed."""
        super().on_report(report, stamp_ns)
        self._flight.on_vehicle(armed=report.armed, landed=report.landed)

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Takes the set-point for the control law."""
        self._flight.on_setpoint(setpoint)

    def send_order(self, order: ChassisOrder) -> None:
        """Sends an order to the device; an order with gains is executed here by the control law."""
        if order.action is not ChassisAction.GAINS:
            self.carry_order(order)
            return
        refusal = ""
        try:
            self._flight.controller.set_gains(order.gains)
        except Denied as error:
            refusal = str(error)
        state, module = self.state, self.module
        if state is not None and module is not None:
            answer = ChassisReport(state.armed, state.landed, order.number, refusal)
            self.on_report(answer, module.now_ns())
