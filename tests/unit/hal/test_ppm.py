"""The sum signal of a receiver: intervals of edges, and its driver on a line of a simulated GPIO chip."""

import errno
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.config import Config, PpmDriver
from swarmd.hal.drivers.ppm import PpmReceiver
from swarmware.devices.crsf import RcChannels
from swarmware.devices.ppm import PpmDecoder
from swarmware.module.module import Module
from swarmware.types.control import SafetySwitch
from swarmware.types.driver import DriverTable
from swarmware.types.vehicle import Setpoint, VehicleMode

FRAME_US = 22_500.0
FAST = Config(drivers=(), retry_s=0.05, failures=1, report_hz=50.0)


def edges(*positions: float, start_ns: int = 0) -> list[int]:
    """Rising edges of one frame and of its end, after a pause."""
    stamps = [start_ns]
    for position in positions:
        stamps.append(stamps[-1] + round((1500 + 500 * position) * 1000))
    return [*stamps, start_ns + round(FRAME_US * 1000)]


def fed(decoder: PpmDecoder, stamps: list[int]) -> list[RcChannels]:
    return [found for stamp_ns in stamps if (found := decoder.edge(stamp_ns)) is not None]


def test_a_frame_is_the_channels_between_two_pauses() -> None:
    decoder = PpmDecoder()
    first, second = edges(0.0, 0.5, -1.0, 1.0, 0.0, 1.0), edges(0.1, 0.0, 0.0, 0.0, start_ns=22_500_000)
    assert fed(decoder, first) == [], "the pause before it was not seen"
    (found,) = fed(decoder, second[1:])
    assert found.positions[:4] == pytest.approx((0.1, 0.0, 0.0, 0.0))
    assert len(found.positions) == 16
    assert (decoder.valid, sum(decoder.refused.values())) == (1, 0)


@pytest.mark.parametrize(
    ("positions", "reason"),
    [
        ((0.0,) * 3, "too few channels"),
        ((-1.0,) * 17, "too many channels"),
        ((0.0, 0.0, -1.9, 0.0), "interval"),
    ],
)
def test_another_signal_is_refused_by_its_reason(positions: tuple[float, ...], reason: str) -> None:
    decoder = PpmDecoder()
    fed(decoder, [0, 10_000_000])
    assert fed(decoder, edges(*positions, start_ns=10_000_000)[1:]) == []
    assert [text for text in decoder.refused if text.startswith(reason)]
    good = edges(0.0, 0.0, 0.0, 0.0, start_ns=50_000_000)
    assert len(fed(decoder, good)) == 1


def test_lost_edges_wait_for_next_pause() -> None:
    decoder = PpmDecoder()
    fed(decoder, edges(0.0, 0.0)[:-1])
    decoder.on_lost()
    assert fed(decoder, edges(0.0, 0.0, 0.0, 0.0, start_ns=30_000_000)) == []
    assert decoder.refused["edges lost"] == 1


@given(st.lists(st.integers(0, 10**12), max_size=60))
def test_any_edges_are_channels_in_range_or_nothing(stamps: list[int]) -> None:
    for found in fed(PpmDecoder(), stamps):
        assert all(-1.0 <= position <= 1.0 for position in found.positions)


class Chip:
    """The kernel's side of a GPIO chip: a line is a pipe of events."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "gpiochip0"
        self.path.touch()
        self.out = -1
        self.asked: tuple[int, int] | None = None
        """Line and flags that were requested."""
        self._sequence = 0
        self._now_ns = 0

    def ioctl(self, fd: int, request: int, argument: bytearray) -> int:
        if request != 0xC250B407:
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        (line,) = struct.unpack_from("=I", argument, 0)
        (flags,) = struct.unpack_from("=Q", argument, 288)
        self.asked = line, flags
        read, self.out = os.pipe()
        struct.pack_into("=i", argument, 588, read)
        return 0

    def send(self, *positions: float) -> None:
        """One frame with its end."""
        for stamp_ns in edges(*positions, start_ns=self._now_ns)[1:]:
            self._sequence += 1
            os.write(self.out, struct.pack("=QIIII24s", stamp_ns, 1, 17, self._sequence, self._sequence, b""))
            self._now_ns = stamp_ns

    def close(self) -> None:
        if self.out >= 0:
            os.close(self.out)
            self.out = -1


@contextmanager
def chip(folder: Path) -> Iterator[Chip]:
    made = Chip(folder)
    with patch("swarmd.hal.buses.gpio.fcntl.ioctl", made.ioctl):
        try:
            yield made
        finally:
            made.close()


async def sent(made: Chip, other: Module, switch: float) -> None:
    """Frames until the switch is published at this end."""
    board = other.reader("vehicle/switch", SafetySwitch)
    wanted = VehicleMode.MANUAL if switch > 0 else VehicleMode.AUTO
    pace = other.reader("hal/drivers", DriverTable)
    while board.value is None or board.value.mode is not wanted:
        made.send(0.0, 1.0, 0.0, 0.0, 0.0, switch)
        await pace.changed(20.0)


async def test_switch_and_sticks_follow_transmitter_and_line(
    tmp_path: Path,
) -> None:
    with chip(tmp_path) as made:
        driver = PpmReceiver(PpmDriver(device=str(made.path), line=17, speed_m_s=2.0))
        async with running(tmp_path, [driver], FAST) as other:
            table = other.reader("hal/drivers", DriverTable)
            await status(table, "ppm", state="running")
            assert made.asked == (17, (1 << 2) | (1 << 4))
            await sent(made, other, -1.0)
            await sent(made, other, 1.0)
            sticks = other.reader("vehicle/sticks", Setpoint)
            made.send(0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
            assert (sticks.value or await sticks.changed(20.0)).vx_m_s == 2.0
            assert "no valid frame for 1 s" in (await status(table, "ppm", state="failed")).note
            await status(table, "ppm", state="running")
            made.close()
            assert "lost: end of file" in (await status(table, "ppm", state="waiting")).note


async def test_a_chip_that_is_missing_is_waited_for(tmp_path: Path) -> None:
    driver = PpmReceiver(PpmDriver(device=str(tmp_path / "gpiochip9")))
    async with running(tmp_path, [driver], FAST) as other:
        table = other.reader("hal/drivers", DriverTable)
        assert "gpiochip9: no such device" in (await status(table, "ppm", state="waiting")).note
