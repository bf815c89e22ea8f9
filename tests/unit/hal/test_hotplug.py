"""A device that is plugged in is recognised by its file and USB number, and gets its driver."""

import os
import pty
import shutil
import tty
from pathlib import Path

import pytest
from tests.unit.devices.receivers import CLASSIC
from tests.unit.hal.rig import running
from tests.unit.hal.status import state_of, status

from swarmd.hal.config import Config, RecognitionRule
from swarmd.hal.core.recognition import DeviceNode, Recognised, Recognition
from swarmd.hal.hotplug import configured, nodes, usb_id
from swarmware.errors import ConfigError
from swarmware.model.config import parse
from swarmware.runtime.pseudo_terminal import PseudoTerminal
from swarmware.types.driver import DriverTable
from swarmware.types.health import CheckReports
from swarmware.types.vehicle import GnssFix

GNSS = RecognitionRule(path="/dev/ttyUSB*", usb="1546:01A8", driver="nmea", settings={"baud": 38400})
ANY = RecognitionRule(path="/dev/ttyUSB*", driver="anemometer")


def test_first_matching_rule_decides_and_recognises_once() -> None:
    recognition = Recognition((GNSS, ANY))
    receiver = DeviceNode("/dev/ttyUSB1", "1546:01a8")
    other = DeviceNode("/dev/ttyUSB0", "0403:6001")
    unknown = DeviceNode("/dev/ttyACM0", "1546:01a8")
    assert recognition.on_nodes([receiver, unknown, other]) == [
        Recognised(other, ANY),
        Recognised(receiver, GNSS),
    ]
    assert recognition.on_nodes([]) == []
    assert recognition.on_nodes([receiver, other]) == []


def test_driver_gets_its_device_and_settings_of_rule() -> None:
    config = configured(Config(), Recognised(DeviceNode("/dev/ttyUSB1"), GNSS))
    assert (config.nmea.device, config.nmea.baud, config.nmea.path) == ("/dev/ttyUSB1", 38400, "sensor/gnss")
    config = Config(plugins={"anemometer": {"rate_hz": 2.0}})
    plugin = configured(config, Recognised(DeviceNode("/dev/ttyUSB0"), ANY))
    assert plugin.plugins["anemometer"] == {"rate_hz": 2.0, "device": "/dev/ttyUSB0"}


def test_invalid_rule_setting_is_named_with_place() -> None:
    rule = RecognitionRule(path="/dev/ttyUSB*", driver="nmea", settings={"bauds": 1})
    with pytest.raises(ConfigError, match=r"rule for /dev/ttyUSB\*: .*bauds"):
        configured(Config(), Recognised(DeviceNode("/dev/ttyUSB1"), rule))


@pytest.mark.parametrize(
    "key", ['path = "ttyUSB*"', 'path = "/dev/*/x"', 'path = "/dev/a"\nusb = "1546"', 'bath = ""']
)
def test_a_rule_that_cannot_fit_is_refused(key: str) -> None:
    with pytest.raises(ConfigError, match="recognise"):
        parse(f'[[recognise]]\ndriver = "nmea"\n{key}\n', Config, "hal.toml")


def test_usb_number_comes_from_next_parent(tmp_path: Path) -> None:
    usb = tmp_path / "devices/usb1/1-2"
    port = usb / "1-2:1.0/ttyUSB0"
    port.mkdir(parents=True)
    (usb / "idVendor").write_text("1546\n")
    (usb / "idProduct").write_text("01A8\n")
    (tmp_path / "class/tty/ttyUSB0").mkdir(parents=True)
    (tmp_path / "class/tty/ttyUSB0/device").symlink_to(port)
    (tmp_path / "class/tty/ttyS0/device").mkdir(parents=True)
    assert usb_id("ttyUSB0", tmp_path) == "1546:01a8"
    assert usb_id("ttyS0", tmp_path) == usb_id("ttyUSB9", tmp_path) == ""
    (tmp_path / "ttyUSB0").touch()
    assert list(nodes([f"{tmp_path}/ttyU*"], tmp_path)) == [
        DeviceNode(str(tmp_path / "ttyUSB0"), "1546:01a8")
    ]


async def test_receiver_publishes_at_each_plugging(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "dev"
    folder.mkdir()
    rule = RecognitionRule(path=f"{folder}/gnss*", driver="nmea", settings={"rate_hz": 50.0})
    config = Config(drivers=(), recognise=(rule,), retry_s=600.0, report_hz=50.0)
    async with running(tmp_path, [], config) as other:
        board = other.reader("hal/drivers", DriverTable)
        fixes = other.reader("sensor/gnss", GnssFix)
        for _ in range(2):
            master, slave = pty.openpty()
            tty.setraw(slave)
            (folder / "gnss0").symlink_to(os.ttyname(slave))
            await status(board, "nmea.gnss0", state="running")
            os.write(master, CLASSIC)
            assert (await fixes.changed(20.0)).satellites == 8
            (folder / "gnss0").unlink()
            os.close(slave)
            os.close(master)
            await status(board, "nmea.gnss0", state="waiting")


async def test_late_or_recreated_device_folder_is_watched(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "dev/serial/by-id"
    rule = RecognitionRule(path=f"{folder}/gnss*", driver="nmea", settings={"rate_hz": 50.0})
    config = Config(drivers=(), recognise=(rule,), retry_s=600.0, report_hz=50.0)
    async with running(tmp_path, [], config) as other:
        board = other.reader("hal/drivers", DriverTable)
        await board.changed(20.0)
        for _ in range(2):
            folder.mkdir(parents=True)
            for _ in range(5):  # the events of the folders have been taken before the device appears
                await board.changed(20.0)
            line = PseudoTerminal(folder / "gnss0", lambda data: None)
            await status(board, "nmea.gnss0", state="running")
            line.close()
            shutil.rmtree(tmp_path / "dev")
            await status(board, "nmea.gnss0", state="waiting")


def test_link_has_usb_number_of_its_target(tmp_path: Path) -> None:
    usb = tmp_path / "devices/usb1/1-2"
    usb.mkdir(parents=True)
    (usb / "idVendor").write_text("1546\n")
    (usb / "idProduct").write_text("01A8\n")
    (tmp_path / "class/tty/ttyUSB0").mkdir(parents=True)
    (tmp_path / "class/tty/ttyUSB0/device").symlink_to(usb)
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "by-id").mkdir()
    link = tmp_path / "by-id/usb-u-blox_GNSS-if00"
    link.symlink_to("../ttyUSB0")
    assert list(nodes([f"{tmp_path}/by-id/*"], tmp_path)) == [DeviceNode(str(link), "1546:01a8")]


async def test_device_without_driver_is_fault_and_harmless(tmp_path: Path) -> None:
    folder = tmp_path / "dev"
    folder.mkdir()
    rule = RecognitionRule(path=f"{folder}/*", driver="nothing")
    async with running(tmp_path, [], Config(drivers=(), recognise=(rule,), report_hz=50.0)) as other:
        board = other.reader("hal/drivers", DriverTable)
        await board.changed(20.0)
        (folder / "strange").touch()
        assert await state_of(other.reader("health/checks/hal", CheckReports), "hal/recognised", "refused")
        assert (await board.changed(20.0)).drivers == ()
