"""Driver of an airframe with motors and servos on PWM, flown by the flight controller."""

import logging
import os
from collections.abc import Sequence
from typing import Final

from swarmd.hal.blocking import DeviceThread
from swarmd.hal.buses.end_writer import EndWriter
from swarmd.hal.buses.pwm import PwmChannel
from swarmd.hal.config import ChassisConfig, Config, MotorPulse, PwmFlightDriver, ServoPulse
from swarmd.hal.core.condition import Condition
from swarmd.hal.core.flight.control_law import HoverLaw
from swarmd.hal.core.flight.flight_core import FlightTiming, flight_timing, hover_law
from swarmd.hal.core.flight.motor_phase import FlightSample, MotorPhase, MotorSwitch
from swarmd.hal.driver import Device, Site
from swarmd.hal.flight_controller import FlightController
from swarmware.errors import ConfigError
from swarmware.model.airframe import Airframe, MultirotorAirframe
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.module.module import Module
from swarmware.types.chassis import ActuatorOutputs, ChassisOrder, ChassisReport
from swarmware.types.vehicle import Setpoint

log = logging.getLogger("swarm.hal")

REALTIME: Final = frozenset({os.SCHED_FIFO, os.SCHED_RR})
_RESET_ON_FORK: Final = 0x40000000
"""Flag SCHED_RESET_ON_FORK in sched_getscheduler's result. Source: Linux, include/uapi/linux/sched.h."""
_REPORT_NS: Final = 500_000_000
"""Period of unchanged reports, because a chassis that is silent for 3 s counts as lost."""
_HELICOPTER: Final = (1, 4)
"""Numbers of motors and of servos of a helicopter: two cyclic servos, collective, pedal."""


class PwmFlight(FlightController):
    """Flight controller whose motors follow the pulse widths of Linux's PWM.

    The chip continues its pulses when this process hangs or is killed, so another process ends them (ADR 69).
    """

    def __init__(
        self, config: ChassisConfig, settings: PwmFlightDriver, law: HoverLaw, timing: FlightTiming
    ) -> None:
        super().__init__("pwm_flight", config, law, timing, settings.imu, settings.imu_hz)
        self._settings = settings
        self._law = law
        self._switch = MotorSwitch()
        self._setpoint = Setpoint(0.0)
        self._outputs: ActuatorOutputs | None = ActuatorOutputs()
        """Outputs of the newest step, or None before the first step of a flight that was taken over."""
        self._reported: tuple[ChassisReport, int] | None = None
        """The newest report, and its instant."""
        self._thread: DeviceThread | None = None
        self._former: DeviceThread | None = None
        self._channels: list[PwmChannel] = []
        self._end_writer: EndWriter | None = None
        self._widths_us: Sequence[float] = ()
        """Present pulse widths of the channels, or () if unknown."""
        self._scheduling_stated = False

    async def open(self, module: Module) -> None:
        """Opens the channels; unless the vehicle is in flight, the motors stop and it is disarmed.

        Raises: DeviceError, DeviceGone.
        """
        flies = self.take_over(module)
        self._switch = MotorSwitch(self._timing.held_s, module.now_ns() if flies else None)
        self._outputs, self._reported = None if flies else ActuatorOutputs(), None
        self._thread = self._former = DeviceThread(self.name, self._former)
        await self._thread.run(lambda: self._connect(keeps=flies))
        await super().open(module)
        self._report(module.now_ns())

    def _connect(self, *, keeps: bool) -> None:
        settings = self._settings
        numbers = [one.channel for one in settings.motors] + [one.channel for one in settings.servos]
        for number in numbers:
            # in flight the channels keep their pulses while they are opened
            self._channels.append(PwmChannel(settings.device, number, 1 / settings.pulses_hz, keeps=keeps))
        if not keeps:
            self._stop()
        # prepared now, because a hanging process cannot compute them
        pairs = zip(self._channels, self._widths(ActuatorOutputs()), strict=True)
        texts = [text for channel, width_us in pairs for text in channel.texts(width_us)]
        held_s = self._timing.held_s
        self._end_writer = EndWriter(texts, held_s, held_s)

    async def write(self, now_ns: int) -> bool:
        """Runs the control law for the newest inertial sample, and sets the pulses.

        Raises: DeviceError when a channel fails.
        """
        stepped = await super().write(now_ns)
        if self._switch.stop_if_blind(now_ns):
            log.warning("driver %s: no inertial samples; the motors are stopped", self.name)
        self._report(now_ns)
        if self._outputs is None and self._switch.report.armed:
            return stepped  # the outputs of the previous process are held until the first step
        widths = self._widths(self._switch.outputs(self._outputs or ActuatorOutputs()))
        if self._thread is not None:
            await self._thread.run(lambda: self._carry(widths))
        return stepped

    def conditions(self, now_ns: int) -> Sequence[Condition]:
        """Changed faults of the flight; the first call also returns the scheduling, on which real motors
        depend."""
        found = super().conditions(now_ns)
        if self._scheduling_stated:
            return found
        self._scheduling_stated = True
        return [*found, scheduling(os.sched_getscheduler(0))]

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Takes the set-point for the control law."""
        self._setpoint = setpoint
        super().send_setpoint(setpoint, stamp_ns)

    def send_outputs(self, outputs: ActuatorOutputs, stamp_ns: int) -> None:
        """Takes the outputs of one step; `write` sets the pulses."""
        self._outputs = outputs
        sample = FlightSample(self.flight_state, self._law.lift_ratio, self._setpoint.vz_m_s)
        self._switch.on_step(sample, stamp_ns)

    def carry_order(self, order: ChassisOrder) -> None:
        """Executes the order; an order to stop the motors takes effect at once."""
        module, thread = self.module, self._thread
        if module is None or thread is None:
            return
        report = self._switch.on_order(order, module.now_ns())
        if not report.armed:
            # not in the next period, which may be late
            thread.post(self._stop)
        self.on_report(report, module.now_ns())

    def _report(self, now_ns: int) -> None:
        report = self._switch.report
        if self._reported is None or self._reported[0] != report or now_ns - self._reported[1] >= _REPORT_NS:
            self._reported = (report, now_ns)
            self.on_report(report, now_ns)

    def _widths(self, outputs: ActuatorOutputs) -> list[float]:
        """Pulse widths in µs; missing outputs stop the motors and centre the servos."""
        motors, servos = self._settings.motors, self._settings.servos
        found = [one.width_us(value) for one, value in zip(motors, outputs.motors, strict=False)]
        found += [one.width_us(0.0) for one in motors[len(found) :]]
        found += [one.width_us(value) for one, value in zip(servos, outputs.servos, strict=False)]
        return found + [one.width_us(0.0) for one in servos[len(found) - len(motors) :]]

    def _stop(self) -> None:
        """Stops the motors, in the thread of the device."""
        self._carry(self._widths(ActuatorOutputs()))

    def _carry(self, widths_us: Sequence[float]) -> None:
        """Sets the changed pulses, in the thread of the device."""
        # the other process may have ended the pulses, so their present widths are not known
        if self._end_writer is not None and self._end_writer.keep():
            self._widths_us = ()
            for channel in self._channels:
                channel.forget()
        # writes to sysfs are costly, and at rest the widths do not change
        if widths_us == self._widths_us:
            return
        self._widths_us = ()
        for channel, width_us in zip(self._channels, widths_us, strict=True):
            channel.set_pulse(width_us)
        self._widths_us = widths_us

    def _disconnect(self) -> None:
        channels, self._channels = self._channels, []
        if self._switch.phase is MotorPhase.AIRBORNE and self._end_writer is not None:
            # as after a kill, the outputs are held until this driver or another process continues the flight
            self._end_writer.leave()
            self._end_writer = None
            self._close(channels)
            return
        try:
            for channel, width_us in zip(channels, self._widths(ActuatorOutputs()), strict=False):
                channel.set_pulse(width_us)
        finally:
            self._close(channels)
            if self._end_writer is not None:
                self._end_writer.close()
                self._end_writer = None

    def _close(self, channels: Sequence[PwmChannel]) -> None:
        self._widths_us = ()
        for channel in channels:
            channel.close()

    async def close(self) -> None:
        """Closes the channels, and stops the motors unless the vehicle is in flight."""
        await super().close()
        if self._thread is not None:
            self._thread.close(self._disconnect)
            self._thread = None


def scheduling(policy: int) -> Condition:
    """Condition that the process of the control loop has real-time scheduling."""
    name, description = "flight/scheduling", "The loop of real motors has real-time scheduling"
    if policy & ~_RESET_ON_FORK in REALTIME:
        return Condition(name, description)
    expected = "expected [realtime] services = { hal = 50 } in node.toml"
    return Condition(name, description, "shared", "warn", f"other work delays the loop: {expected}")


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the airframe.

    Raises: ConfigError when the platform has no airframe, or another number of outputs than the airframe.
    """
    airframe, settings = site.airframe, config.pwm_flight
    if airframe is None:
        raise ConfigError("driver pwm_flight: no airframe; expected `airframe` in node.toml")
    if isinstance(airframe, FixedWingAirframe):
        raise ConfigError(
            "driver pwm_flight: a fixed wing; expected an airframe that can hover, because this driver"
            " cannot detect that an aircraft has landed"
        )
    _check_outputs(airframe, settings.motors, settings.servos)
    return [PwmFlight(config.chassis, settings, hover_law(airframe), flight_timing(airframe))]


def _check_outputs(airframe: Airframe, motors: Sequence[MotorPulse], servos: Sequence[ServoPulse]) -> None:
    """Checks the number of outputs. Raises: ConfigError."""
    wanted = (len(airframe.rotors), 0) if isinstance(airframe, MultirotorAirframe) else _HELICOPTER
    for name, given, expected in zip(("motors", "servos"), (motors, servos), wanted, strict=True):
        if len(given) != expected:
            raise ConfigError(
                f"services/hal.toml: key pwm_flight.{name}: {len(given)} given; expected {expected}, in the"
                " order of the airframe"
            )
