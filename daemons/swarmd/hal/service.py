"""Shell of the hardware abstraction layer: runs a task per driver, and publishes their timing statistics."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import ClassVar, Final

from swarmd.hal import config as settings
from swarmd.hal import hotplug
from swarmd.hal.catalogue import check_names, find, make_all
from swarmd.hal.chassis import Chassis
from swarmd.hal.core.line_load import is_over, line_loads
from swarmd.hal.core.recognition import Recognition
from swarmd.hal.core.schedule import Schedule
from swarmd.hal.driver import Actuator, Device, DeviceError, DeviceGone, Sensor, Site
from swarmd.hal.imu_source import ImuSource
from swarmd.hal.motors import Motors
from swarmd.hal.precise_timer import PreciseTimer
from swarmd.hal.sensor_calibration import SensorCalibrations
from swarmware.errors import SwarmError
from swarmware.model import paths
from swarmware.module.module import Module
from swarmware.module.wakeup import Wakeup
from swarmware.runtime.instant import stage_phase_ns, until
from swarmware.service.service import Service
from swarmware.types.driver import DriverState, DriverTable, LineLoad
from swarmware.types.health import OK_STATE, Level

SENSOR_STAGE: Final = 1
"""Stage of an instant in which sensors are read, after the simulation's writes and before consumers
compute."""
ACTUATOR_STAGE: Final = 4
"""Stage of an instant in which actuators are written, after navigation (2) and control (3)."""

COARSE_S: Final = 0.02
"""Period from which drivers wait on the event loop, up to 2 ms too long, and share wake-ups with other work.
Drivers with shorter periods have a kernel timer each."""

_FAILED: Final = {DriverState.FAILED: "failed", DriverState.WAITING: "unplugged"}
"""State of the health check of a driver, by the state of the driver."""

_FAILSAFE: Final = {"ok": "ok", "warn": "failsafe", "error": "lost"}
"""State of the health check of an actuator's fail-safe, by the level of the fault."""

log = logging.getLogger("swarm.hal")


class Hal(Service):
    """Runs the drivers of the platform."""

    name = "hal"
    Config: ClassVar = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node.config
        airframe = None
        if node.airframe:
            from swarmware.model.airframe_file import load_airframe  # not loaded by most vehicles

            airframe = load_airframe(node.share_path, node.airframe)
        self._site = Site(node.kind, str(node.share_path / "data"), airframe)
        self._devices = make_all(config, self._site)
        self._calibrations = SensorCalibrations(
            module, lambda: self._devices, paths.imu_calibration(node.data_path)
        )
        self._schedules: dict[str, Schedule] = {}
        self._lines: tuple[LineLoad, ...] = ()
        self._recognition = Recognition(config.recognise)
        self._plugged = Wakeup()
        """Event that wakes waiting drivers when device files appear."""

    async def run(self) -> None:
        """Runs each driver in a task until the service ends."""
        patterns = {rule.path for rule in self.config.recognise}
        watch: hotplug.FolderWatch | None = None
        try:
            async with asyncio.TaskGroup() as group:
                self._start(group, self._devices)
                if any(isinstance(device, ImuSource) for device in self._devices):
                    self._calibrations.serve()
                group.create_task(self._report(), name="hal:report")
                if patterns:
                    folders = [pattern.rpartition("/")[0] or "/" for pattern in patterns]
                    watch = hotplug.FolderWatch(folders, lambda: self._recognise(group, patterns))
                    self._recognise(group, patterns)
        finally:
            if watch is not None:
                watch.close()

    def _start(self, group: asyncio.TaskGroup, devices: Sequence[Device]) -> None:
        """Starts the tasks of drivers, and serves their requests."""
        self._calibrations.apply()
        processes = self.module.node.config.processes
        for device in devices:
            if isinstance(device, Chassis):
                Motors(self.module, device).serve()
            schedule = self._schedules[device.name] = Schedule(
                device.name,
                device.period_s,
                self.module.now_ns(),
                stage_phase_ns(processes, _stage(device)),
                actuator=isinstance(device, Actuator),
            )
            if isinstance(device, Actuator):
                # at the start, because a check that is first reported in an emergency is announced as a new
                # resource
                self._report_failsafe(device, "ok", "")
            group.create_task(self._keep(device, schedule), name=f"driver:{device.name}")
        self._check_lines()

    def _check_lines(self) -> None:
        """Computes the load of the lines of all drivers, and reports overloaded lines."""
        uses = [(device.name, use) for device in self._devices for use in device.line_uses]
        self._lines = line_loads(uses, self.config.line_bit_s)
        for line in self._lines:
            if not is_over(line):
                continue
            detail = (
                f"{line.device}: {', '.join(line.drivers)} ask {line.asked_bit_s / 1e3:.1f} kbit/s of"
                f" {line.capacity_bit_s / 1e3:.1f}"
            )
            log.warning("line %s", detail)
            self.health.report(
                "line",
                "overloaded",
                level="warn",
                detail=detail,
                description="Lines and buses carry what the drivers ask",
            )

    def _recognise(self, group: asyncio.TaskGroup, patterns: set[str]) -> None:
        """Starts the drivers of devices that were plugged in, and lets waiting drivers retry at once."""
        for one in self._recognition.on_nodes(hotplug.nodes(patterns)):
            try:
                devices = find(one.rule.driver)(hotplug.configured(self.config, one), self._site)
                for device in devices:
                    device.name = f"{device.name}.{Path(one.node.path).name}"
                # two devices of one name would share schedule and health check
                check_names(devices, self._devices)
            except SwarmError as error:
                log.warning("device %s: driver %s: %s", one.node.path, one.rule.driver, error)
                self.health.report(
                    "recognised",
                    "refused",
                    detail=f"{one.node.path}: {error}",
                    description="Devices that were plugged in have a driver",
                )
                continue
            log.info("device %s: recognised, driver %s", one.node.path, one.rule.driver)
            self._devices += devices
            self._start(group, devices)
        # also without a new device: a waiting driver may have its file again
        self._plugged.notify()

    async def _keep(self, device: Device, schedule: Schedule) -> None:
        """Opens and serves a device, and reopens it after failures, which are reported as faults."""
        check = f"driver/{_check_name(device)}"
        fault = ""
        while True:
            try:
                await device.open(self.module)
                schedule.opened(self.module.now_ns())
                log.info("driver %s: open, %g Hz", device.name, 1 / device.period_s)
                if fault:
                    fault = ""
                    self.health.report(check)
                await self._serve(device, schedule)
            except (DeviceError, OSError) as error:
                failed = isinstance(error, DeviceError) and not isinstance(error, DeviceGone)
                state = DriverState.FAILED if failed else DriverState.WAITING
                schedule.closed(state, str(error))
                # a warning only once per fault, not at each retry
                level = logging.DEBUG if str(error) == fault else logging.WARNING
                log.log(level, "driver %s: %s; again in %g s", device.name, error, self.config.retry_s)
                fault = str(error)
                self.health.report(
                    check,
                    _FAILED[state],
                    detail=str(error),
                    description=f"The device of driver {device.name}",
                )
            finally:
                # also after a failed opening, which may have opened a part
                await device.close()
            await self._plugged.wait(self.config.retry_s)

    async def _serve(self, device: Device, schedule: Schedule) -> None:
        """Reads or writes the device once per period, which each call may change.

        Raises: DeviceError after too many consecutive failures; DeviceGone.
        """
        now_ns, stage = self.module.now_ns, _stage(device)
        step = _step(device)
        timer = PreciseTimer() if device.period_s < COARSE_S else None
        try:
            while True:
                if timer is None:
                    await until(self.module.clock, schedule.due_ns, stage)
                else:
                    await timer.until(self.module.clock.to_mono_ns(schedule.due_ns))
                begin_ns = now_ns()
                # before the call, so that a slow device delays its statistics and not its schedule
                schedule.begin(begin_ns)
                try:
                    if await step(begin_ns):
                        schedule.done()
                    schedule.retime(device.period_s)
                except DeviceGone:
                    raise
                except (SwarmError, OSError) as error:
                    if schedule.failed(str(error)) >= self.config.failures:
                        raise DeviceError(f"{self.config.failures} calls failed in a row: {error}") from error
                if isinstance(device, Actuator):
                    self._watch(device, schedule, begin_ns)
                elif isinstance(device, Sensor) and schedule.stalled(reason := device.stalled(begin_ns)):
                    self._report_stalled(device, reason)
        finally:
            if timer is not None:
                timer.close()

    def _watch(self, actuator: Actuator, schedule: Schedule, now_ns: int) -> None:
        """Reports changed conditions of an actuator, and the begin and end of its fail-safe."""
        for one in actuator.conditions(now_ns):
            if one.detail:
                log.warning("driver %s: %s %s: %s", actuator.name, one.name, one.state, one.detail)
            self.health.report(
                one.name, one.state, level=one.level, detail=one.detail, description=one.description
            )
        reason = actuator.failsafe(now_ns)
        level = schedule.safe(reason, now_ns)
        if level is None:
            return
        if reason:
            log.warning("driver %s: fail-safe (%s): %s", actuator.name, level, reason)
        else:
            log.info("driver %s: set-points arrive again", actuator.name)
        self._report_failsafe(actuator, level, reason)

    def _report_stalled(self, sensor: Sensor, reason: str) -> None:
        if reason:
            log.warning("driver %s: no measurements: %s", sensor.name, reason)
        else:
            log.info("driver %s: measurements arrive again", sensor.name)
        self.health.report(
            f"driver/{_check_name(sensor)}",
            "no data" if reason else OK_STATE,
            detail=reason,
            description=f"The device of driver {sensor.name}",
        )

    def _report_failsafe(self, actuator: Actuator, level: Level, reason: str) -> None:
        self.health.report(
            f"failsafe/{_check_name(actuator)}",
            _FAILSAFE[level],
            level=level,
            detail=reason,
            description=f"Set-points for {actuator.name} arrive",
        )

    async def _report(self) -> None:
        writer = self.module.writer("hal/drivers", DriverTable, rate_hz=self.config.report_hz)
        async for _ in self.module.every(1 / self.config.report_hz):
            now_ns = self.module.now_ns()
            rows = tuple(schedule.report(now_ns) for schedule in self._schedules.values())
            writer.write(DriverTable(rows, self._lines))


def _stage(device: Device) -> int:
    return ACTUATOR_STAGE if isinstance(device, Actuator) else SENSOR_STAGE


def _check_name(device: Device) -> str:
    return device.name.replace(".", "/").replace("-", "_")


def _step(device: Device) -> Callable[[int], Awaitable[bool]]:
    """The method of a device that is called once per period."""
    if isinstance(device, Actuator):
        return device.write
    if isinstance(device, Sensor):
        return device.read
    raise TypeError(f"driver {device.name}: neither a Sensor nor an Actuator")
