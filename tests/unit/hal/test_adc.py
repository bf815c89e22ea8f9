"""Analogue inputs by the files of the kernel, in a folder of the test."""

from pathlib import Path

import pytest
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.config import AdcDriver, AnalogueChannel, Config
from swarmd.hal.driver import DeviceError
from swarmd.hal.drivers.adc import AnalogueInputs
from swarmware.types.driver import DriverTable
from swarmware.types.scalar import Float

CHANNELS = (
    AnalogueChannel(channel=0, path="power/main", per_volt=11.0),
    AnalogueChannel(channel=3, path="sensor/smoke", unit="V"),
)


def converter(root: Path) -> Path:
    folder = root / "iio:device0"
    folder.mkdir()
    for name, text in {
        "in_voltage0_raw": "1000",
        "in_voltage_scale": "2.0",
        "in_voltage3_raw": "500",
        "in_voltage3_scale": "0.5",
        "in_voltage3_offset": "-100",
    }.items():
        (folder / name).write_text(f"{text}\n")
    return folder


async def test_channels_are_published_and_lost_converter_awaited(
    tmp_path: Path,
) -> None:
    folder = converter(tmp_path)
    config = Config(drivers=(), retry_s=0.05, failures=1, report_hz=50.0)
    device = AnalogueInputs(AdcDriver(device=str(folder), rate_hz=100.0, channels=CHANNELS))
    async with running(tmp_path, [device], config) as other:
        board = other.reader("hal/drivers", DriverTable)
        assert await other.reader("power/main", Float).changed(20.0) == Float(22.0)
        assert await other.reader("sensor/smoke", Float).changed(20.0) == Float(0.2)
        folder.rename(tmp_path / "away")
        assert "no such device" in (await status(board, "adc", state="waiting")).note
        (tmp_path / "away").rename(folder)
        await status(board, "adc", state="running")


@pytest.mark.parametrize("text", ["", "much", "1 2", "\xff"])
def test_non_number_is_refused_with_its_file(tmp_path: Path, text: str) -> None:
    folder = converter(tmp_path)
    (folder / "in_voltage0_raw").write_text(text, "latin-1")
    with pytest.raises(DeviceError, match=r"in_voltage0_raw: .*, expected a number"):
        AnalogueInputs(AdcDriver(device=str(folder), channels=CHANNELS)).measure()
