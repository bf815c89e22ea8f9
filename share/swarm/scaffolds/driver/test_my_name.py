"""Tests of my_name, without the daemon hal: a file stands for the device."""

import asyncio
from pathlib import Path

import pytest
from swarmd.hal.config import Config
from swarmd.hal.driver import DeviceError, Sensor, Site
from swarmware import Module
from swarmware.model.platform_kind import PlatformKind
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Float

from my_name import make


def driver_of(device: Path) -> Sensor:
    """The driver with the settings that hal.toml would give it."""
    config = Config(plugins={"my_name": {"device": str(device)}})
    (driver,) = make(config, Site(PlatformKind.UAV, ""))
    return driver


def test_the_number_of_the_device_is_published(tmp_path: Path) -> None:
    device = tmp_path / "device"
    device.write_text("4.25 metres\n")

    async def check() -> None:
        async with tmp_node(tmp_path) as node, Module("hal", node=node) as module:
            board = module.reader("sensor/my_name", Float)
            driver = driver_of(device)
            await driver.open(module)
            assert await driver.read(module.now_ns())
            assert board.value == Float(4.25)
            await driver.close()

    asyncio.run(check())


def test_a_device_that_gives_no_number_is_reported(tmp_path: Path) -> None:
    device = tmp_path / "device"
    device.write_text("far away\n")

    async def check() -> None:
        async with tmp_node(tmp_path) as node, Module("hal", node=node) as module:
            with pytest.raises(DeviceError, match="expected a number"):
                await driver_of(device).open(module)

    asyncio.run(check())
