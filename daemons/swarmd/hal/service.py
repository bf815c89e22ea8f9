"""Shell of the hardware abstraction layer: one task per driver, and a board with their timing statistics."""

import asyncio
import logging
from typing import ClassVar, Final

from swarmd.hal import config as settings
from swarmd.hal.catalogue import make_all
from swarmd.hal.core.schedule import Schedule
from swarmd.hal.driver import DeviceError, Driver, Site
from swarmware.errors import SwarmError
from swarmware.runtime.instant import stage_phase_ns, until
from swarmware.service.service import Service
from swarmware.types.vehicle import DriverState, DriverTable

STAGE: Final = 1
"""Stage of an instant at which drivers read: after the simulation has written, before consumers compute."""

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
        drivers = make_all(self.config, site)
        now_ns = module.now_ns()
        phase_ns = stage_phase_ns(node.config.processes, STAGE)
        schedules = {
            driver.name: Schedule(driver.name, driver.period_s, now_ns, phase_ns) for driver in drivers
        }
        async with asyncio.TaskGroup() as group:
            for driver in drivers:
                group.create_task(self._keep(driver, schedules[driver.name]), name=f"driver:{driver.name}")
            group.create_task(self._report(list(schedules.values())), name="hal:report")

    async def _keep(self, driver: Driver, schedule: Schedule) -> None:
        """Opens and reads the driver; reopens it after failures."""
        while True:
            try:
                await driver.open(self.module)
                schedule.opened(self.module.now_ns())
                log.info("driver %s: open, %g Hz", driver.name, 1 / driver.period_s)
                await self._read(driver, schedule)
            except (DeviceError, OSError) as error:
                failed = isinstance(error, DeviceError)
                schedule.closed(DriverState.FAILED if failed else DriverState.WAITING, str(error))
                log.warning("driver %s: %s; again in %g s", driver.name, error, self.config.retry_s)
            finally:
                await driver.close()
            await asyncio.sleep(self.config.retry_s)

    async def _read(self, driver: Driver, schedule: Schedule) -> None:
        """Reads the device once per period, which each read may change.

        Raises: DeviceError after too many failures in a row.
        """
        now_ns = self.module.now_ns
        while True:
            await until(self.module.clock, schedule.due_ns, STAGE)
            begin_ns = now_ns()
            schedule.begin(begin_ns)
            try:
                if await driver.read(begin_ns):
                    schedule.done()
                schedule.retime(driver.period_s)
            except (SwarmError, OSError) as error:
                if schedule.failed(str(error)) >= self.config.failures:
                    raise DeviceError(f"{self.config.failures} reads failed in a row: {error}") from error

    async def _report(self, schedules: list[Schedule]) -> None:
        writer = self.module.writer("hal/drivers", DriverTable, rate_hz=self.config.report_hz)
        async for _ in self.module.every(1 / self.config.report_hz):
            now_ns = self.module.now_ns()
            writer.write(DriverTable(tuple(schedule.report(now_ns) for schedule in schedules)))
