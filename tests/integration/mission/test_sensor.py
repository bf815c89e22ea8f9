"""A mission that waits for a sensor, played by the real daemon; the sensor is plugged in meanwhile."""

import asyncio
import os
import pty
import tty
from contextlib import suppress
from pathlib import Path

from tests.integration.mission.swarm import Swarm, on_uvloop, swarm
from tests.unit.devices.receivers import CLASSIC
from tests.unit.hal.status import status

from swarmd.hal.config import Config, RecognitionRule
from swarmd.hal.service import Hal
from swarmware.module.module import Module
from swarmware.types.driver import DriverTable
from swarmware.types.mission import MissionFile, MissionTask, TaskAnswer
from swarmware.types.vehicle import Barometer, GnssFix


async def start(s: Swarm, wait: str) -> None:
    """Starts a mission of one platform that waits for a sensor."""
    text = f"""{{"mission": {{
        "s": {{"type": "Start", "next": "w"}},
        "w": {{"type": "WaitForSensor", {wait}, "next": "e", "nextTimeout": "f"}},
        "e": {{"type": "End"}},
        "f": {{"type": "End", "result": "failed"}}
    }}}}"""
    task = MissionTask("wait", (MissionFile("wait.json", text),), members=("uav1",))
    assert (await s.ask("sys/mission/task", task, TaskAnswer)).accepted
    await s.until(lambda: "running" in s["uav1"].history)


@on_uvloop
async def test_mission_waits_until_sensor_measures_what_it_needs(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        body = s["uav1"].vehicle.module
        fixes = body.writer("sensor/gnss", GnssFix)
        fixes.write(GnssFix(47.0, 8.0, 400.0, 9.0, 3))
        await start(s, '"measures": "satellites", "until": "satellites >= 6"')
        air = body.writer("sensor/air", Barometer)
        air.write(Barometer(101_325.0, 20.0))
        fixes.write(GnssFix(47.0, 8.0, 400.0, 9.0, 5))
        assert s["uav1"].history[-1:] == ["running"]
        fixes.write(GnssFix(47.0, 8.0, 400.0, 1.0, 6))
        await s.until(lambda: s["uav1"].history[-1:] == ["done"])


@on_uvloop
async def test_sensor_that_does_not_come_is_time_out(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        body = s["uav1"].vehicle.module
        body.writer("sensor/gnss", GnssFix).write(GnssFix(47.0, 8.0, 400.0, 1.0, 9))
        await start(s, '"measures": "Barometer", "timeout_s": 0.2')
        await s.until(lambda: s["uav1"].history[-1:] == ["failed"])


@on_uvloop
async def test_receiver_plugged_in_during_mission_ends_wait(tmp_path: Path) -> None:
    folder = tmp_path / "dev"
    folder.mkdir()
    rule = RecognitionRule(path=f"{folder}/gnss*", driver="nmea", settings={"rate_hz": 50.0})
    config = Config(drivers=(), recognise=(rule,), retry_s=600.0)
    async with swarm(tmp_path, "gcs", "uav1") as s, Module("hal", node=s["uav1"].node) as module:
        hal = asyncio.create_task(Hal(module, config).run(), name="hal")
        try:
            await start(s, '"sensor": "sensor/gnss"')
            master, slave = pty.openpty()
            tty.setraw(slave)
            (folder / "gnss0").symlink_to(os.ttyname(slave))
            drivers = module.reader("hal/drivers", DriverTable)
            await status(drivers, "nmea.gnss0", state="running")
            os.write(master, CLASSIC)
            await s.until(lambda: s["uav1"].history[-1:] == ["done"])
            (folder / "gnss0").unlink()
            os.close(slave)
            os.close(master)
        finally:
            hal.cancel()
            with suppress(asyncio.CancelledError):
                await hal
