"""Drivers of each kind of platform, and the filter of the sonar."""

import msgspec
import pytest

from swarmd.hal.catalogue import DRIVERS, find, make_all
from swarmd.hal.chassis import Chassis
from swarmd.hal.config import Config
from swarmd.hal.core.median import MedianFilter
from swarmd.hal.driver import Driver, Sensor, Site
from swarmware.errors import ConfigError, NotFound
from swarmware.model.config import parse
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.chassis import ChassisOrder
from swarmware.types.vehicle import Setpoint

UGV, UAV, GCS = (Site(kind, "/nowhere") for kind in (PlatformKind.UGV, PlatformKind.UAV, PlatformKind.GCS))


def names(config: Config, site: Site) -> list[str]:
    return [driver.name for driver in make_all(config, site)]


def test_vehicle_has_its_simulated_devices_and_its_computer() -> None:
    devices = ["sim.gnss", "sim.range", "sim.battery", "sim.imu", "sim.chassis"]
    assert names(Config(), UGV) == [*devices, "system"]
    assert names(Config(), UAV) == [*devices, "sim.sonar", "system"]
    assert names(Config(), GCS) == ["system"]


def test_a_driver_is_chosen_by_configuration_only() -> None:
    assert names(Config(drivers=("replay",)), UGV) == ["replay"]
    assert names(Config(drivers=()), UGV) == []


def test_periods_are_those_of_the_devices() -> None:
    periods = {driver.name: driver.period_s for driver in make_all(Config(), UAV)}
    assert periods == {
        "sim.gnss": 0.1,
        "sim.imu": 0.05,
        "sim.range": 0.1,
        "sim.battery": 1.0,
        "sim.chassis": 0.05,
        "sim.sonar": 0.05,
        "system": 1.0,
    }


def test_unknown_driver_is_named_with_known_ones() -> None:
    with pytest.raises(
        NotFound,
        match=r"'lidar': not installed; expected one of adc, bmp280, .*, system, vectornav, vesc",
    ):
        make_all(Config(drivers=("lidar",)), UGV)


def test_the_same_device_twice_is_refused() -> None:
    with pytest.raises(ConfigError, match="system is listed twice"):
        make_all(Config(drivers=("system", "system")), UGV)


class Wheels(Chassis):
    """A chassis of another package, whose device is missing."""

    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        raise OSError("unplugged")

    def send_order(self, order: ChassisOrder) -> None:
        raise OSError("unplugged")


def test_second_chassis_on_platform_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    find("sim")  # the module must be loaded to be replaced
    monkeypatch.setattr(
        "swarmd.hal.drivers.system.make", lambda config, site: [Wheels("wheels", config.chassis)]
    )
    with pytest.raises(ConfigError, match=r"sim.chassis and wheels both drive the vehicle, expected one"):
        make_all(Config(), UGV)


def test_driver_of_earlier_version_is_sensor() -> None:
    assert Driver is Sensor


class Sonar(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a driver of another package."""

    rate_hz: float = 5.0


def test_driver_of_another_package_has_own_table() -> None:
    config = parse("[plugins.sonar]\nrate_hz = 2.0\n", Config, "hal.toml")
    assert config.plugin("sonar", Sonar) == Sonar(2.0)
    assert Config().plugin("sonar", Sonar) == Sonar(5.0)


def test_invalid_driver_key_is_named_with_place() -> None:
    config = parse("[plugins.sonar]\nrate = 2.0\n", Config, "hal.toml")
    with pytest.raises(ConfigError, match=r"services/hal.toml: table plugins.sonar: key rate: unknown"):
        config.plugin("sonar", Sonar)


@pytest.mark.parametrize("name", DRIVERS)
def test_every_listed_driver_can_be_loaded(name: str) -> None:
    assert callable(find(name))


def test_the_median_ignores_wrong_echoes() -> None:
    smooth = MedianFilter(5)
    out = [smooth.add(value) for value in (2.0, 2.1, 6.4, 2.2, 0.1, 2.3, 2.4)]
    assert all(1.9 < value < 2.5 for value in out[2:])
    smooth.reset()
    assert smooth.add(5.0) == 5.0
