"""Load of lines and buses by drivers, compared with the capacity: computed, refused, reported."""

from pathlib import Path

import pytest
from tests.unit.hal.rig import running
from tests.unit.hal.status import Counter, state_of

from swarmd.hal.catalogue import make_all
from swarmd.hal.config import (
    Bmp280Driver,
    Config,
    InvensenseDriver,
    NmeaDriver,
    SonarDriver,
    VescDriver,
    VescMotor,
)
from swarmd.hal.core.line_load import LineUse, can_use, crowded, is_over, line_loads, register_use, serial_use
from swarmd.hal.driver import Site
from swarmware.errors import ConfigError
from swarmware.model.config import parse
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.driver import DriverTable, LineLoad
from swarmware.types.health import CheckReports

SITE = Site(PlatformKind.UAV, "")
I2C = "/dev/i2c-1"


def loads(config: Config) -> dict[str, LineLoad]:
    devices = make_all(config, SITE)
    uses = [(device.name, use) for device in devices for use in device.line_uses]
    return {load.device: load for load in line_loads(uses, config.line_bit_s)}


def test_bits_per_line_match_its_frames() -> None:
    assert serial_use("/dev/ttyS0", 9600, 100.0).bit_s == 1000.0
    assert register_use("i2c", I2C, 0, (1, 6), 10.0).bit_s == (4 + 9) * 9 * 10.0
    assert register_use("spi", "/dev/spidev0.0", 1_000_000, (14,), 100.0).bit_s == 15 * 8 * 100.0
    # eight bytes: 131 bits and at most 29 stuffed ones
    assert can_use("can0", [(8, 1.0)]).bit_s == 160.0


def test_drivers_share_bus_and_their_loads_add_up() -> None:
    config = Config(
        drivers=("bmp280", "invensense", "vesc"),
        bmp280=Bmp280Driver(rate_hz=20.0),
        invensense=InvensenseDriver(bus="i2c", device=I2C, rate_hz=200.0),
        vesc=VescDriver(motors=(VescMotor(controller=1, path="act/a", state_path="sensor/a"),)),
        line_bit_s={"can0": 250_000.0},
    )
    found = loads(config)
    assert found[I2C] == LineLoad(I2C, ("bmp280", "invensense"), 117 * 20.0 + 153 * 200.0, 100_000.0)
    assert found["can0"].capacity_bit_s == 250_000.0
    assert not is_over(found[I2C])
    fast = Config(drivers=("invensense",), invensense=InvensenseDriver(bus="i2c", device=I2C, rate_hz=600.0))
    assert is_over(loads(fast)[I2C])
    quick = Config(
        drivers=("invensense",),
        invensense=InvensenseDriver(bus="i2c", device=I2C, rate_hz=600.0),
        line_bit_s={I2C: 400_000.0},
    )
    assert not is_over(loads(quick)[I2C])


def test_shared_serial_line_is_refused_with_both_drivers() -> None:
    both = Config(
        drivers=("nmea", "sonar"),
        nmea=NmeaDriver(device="/dev/ttyS1"),
        sonar=SonarDriver(device="/dev/ttyS1"),
    )
    with pytest.raises(ConfigError, match="device /dev/ttyS1: both nmea and sonar need it"):
        make_all(both, SITE)
    own, shared = LineUse("a", 1.0, 1.0), LineUse("a", 1.0, 1.0, shared=True)
    assert crowded([("one", shared), ("other", shared)]) is None
    assert crowded([("one", shared), ("other", own)]) == ("a", "one", "other")
    assert crowded([("one", own), ("one", own)]) is None


def test_a_capacity_that_no_line_has_is_refused() -> None:
    with pytest.raises(ConfigError, match="line_bit_s"):
        parse('line_bit_s = { "/dev/i2c-1" = 0.0 }', Config, "hal.toml")


async def test_overloaded_line_is_fault_and_in_table(tmp_path: Path) -> None:
    device = Counter("imu", 50.0)
    device.line_uses = (LineUse(I2C, 90_000.0, 100_000.0, shared=True),)
    async with running(tmp_path, [device], Config(drivers=(), report_hz=50.0)) as other:
        table = await other.reader("hal/drivers", DriverTable).changed(20.0)
        assert table.lines == (LineLoad(I2C, ("imu",), 90_000.0, 100_000.0),)
        checks = other.reader("health/checks/hal", CheckReports)
        assert await state_of(checks, "hal/line", "overloaded")
