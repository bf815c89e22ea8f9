"""Shell of the hardware abstraction layer: one task per driver, and a board with their timing statistics."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import ClassVar, Final

from swarmd.hal import config as settings
from swarmd.hal.catalogue import make_all
from swarmd.hal.chassis import Chassis
from swarmd.hal.core.schedule import Schedule
from swarmd.hal.driver import Actuator, Device, DeviceError, Sensor, Site
from swarmd.hal.motors import Motors
from swarmware.errors import SwarmError
from swarmware.runtime.instant import stage_phase_ns, until
from swarmware.service.service import Service
from swarmware.types.vehicle import DriverState, DriverTable

SENSOR_STAGE: Final = 1
"""Stage of an instant at which sensors are read: after the simulation has written, before consumers
compute."""
ACTUATOR_STAGE: Final = 4
"""Stage at which set-points are carried out: after navigation (2) and control (3) have computed them."""

_FAILED: Final = {DriverState.FAILED: "failed", DriverState.WAITING: "unplugged"}
"""State of the health check of a driver, by that of the driver."""

log = logging.getLogger("swarm.hal")


class Hal(Service):
    """Runs the drivers of the platform."""

    name = "hal"
    Config: ClassVar = settings.Config
    config: settings.Config

    async def run(self) -> None:
        """Runs every driver in its own task until the service ends."""
        module = self.module
        node = module.node
        site = Site(node.config.kind, str(node.config.share_path / "data"))
        devices = make_all(self.config, site)
        for device in devices:
            if isinstance(device, Chassis):
                Motors(module, device).serve()
        now_ns = module.now_ns()
        schedules = {
            device.name: Schedule(
                device.name,
                device.period_s,
                now_ns,
                stage_phase_ns(node.config.processes, _stage(device)),
                actuator=isinstance(device, Actuator),
            )
            for device in devices
        }
        async with asyncio.TaskGroup() as group:
            for device in devices:
                group.create_task(self._keep(device, schedules[device.name]), name=f"driver:{device.name}")
            group.create_task(self._report(list(schedules.values())), name="hal:report")

    async def _keep(self, device: Device, schedule: Schedule) -> None:
        """Opens and serves the device; reopens it after failures, which are faults of the platform."""
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
                failed = isinstance(error, DeviceError)
                state = DriverState.FAILED if failed else DriverState.WAITING
                schedule.closed(state, str(error))
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
                await device.close()
            await asyncio.sleep(self.config.retry_s)

    async def _serve(self, device: Device, schedule: Schedule) -> None:
        """Reads or writes the device once per period, which each call may change.

        Raises: DeviceError after too many failures in a row.
        """
        now_ns, stage = self.module.now_ns, _stage(device)
        step = _step(device)
        while True:
            await until(self.module.clock, schedule.due_ns, stage)
            begin_ns = now_ns()
            schedule.begin(begin_ns)
            try:
                if await step(begin_ns):
                    schedule.done()
                schedule.retime(device.period_s)
            except (SwarmError, OSError) as error:
                if schedule.failed(str(error)) >= self.config.failures:
                    raise DeviceError(f"{self.config.failures} calls failed in a row: {error}") from error
            if isinstance(device, Actuator):
                self._watch(device, schedule, begin_ns)

    def _watch(self, actuator: Actuator, schedule: Schedule, now_ns: int) -> None:
        """Publishes and reports when the watchdog of an actuator takes over, and when it ends."""
        reason = actuator.failsafe(now_ns)
        if bool(reason) == (schedule.state is DriverState.FAILSAFE):
            return
        schedule.safe(reason)
        if reason:
            log.warning("driver %s: fail-safe: %s", actuator.name, reason)
        else:
            log.info("driver %s: set-points arrive again", actuator.name)
        self.health.report(
            f"failsafe/{_check_name(actuator)}",
            "failsafe" if reason else "ok",
            detail=reason,
            description=f"Set-points for {actuator.name} arrive",
        )

    async def _report(self, schedules: list[Schedule]) -> None:
        writer = self.module.writer("hal/drivers", DriverTable, rate_hz=self.config.report_hz)
        async for _ in self.module.every(1 / self.config.report_hz):
            now_ns = self.module.now_ns()
            writer.write(DriverTable(tuple(schedule.report(now_ns) for schedule in schedules)))


def _stage(device: Device) -> int:
    return ACTUATOR_STAGE if isinstance(device, Actuator) else SENSOR_STAGE


def _check_name(device: Device) -> str:
    return device.name.replace(".", "/").replace("-", "_")


def _step(device: Device) -> Callable[[int], Awaitable[bool]]:
    """The method that is called once per period."""
    if isinstance(device, Actuator):
        return device.write
    if isinstance(device, Sensor):
        return device.read
    raise TypeError(f"driver {device.name}: neither a Sensor nor an Actuator")
