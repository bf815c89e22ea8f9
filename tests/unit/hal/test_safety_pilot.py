"""The safety pilot's transmitter: switch, sticks, a lost link; and its driver behind a line."""

import asyncio
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.config import Config, CrsfDriver
from swarmd.hal.core.safety_pilot import CONFIRMATIONS, SafetyPilot
from swarmd.hal.drivers.crsf import CrsfReceiver
from swarmware.devices.crsf import RcChannels, channels_frame, link_frame
from swarmware.runtime.pseudo_terminal import PseudoTerminal
from swarmware.types.control import RemoteLink, SafetySwitch
from swarmware.types.driver import DriverTable
from swarmware.types.vehicle import Setpoint, VehicleMode

AUTO, MANUAL = VehicleMode.AUTO, VehicleMode.MANUAL


def channels(switch: float, *sticks: float) -> RcChannels:
    return RcChannels((*sticks, *[0.0] * (5 - len(sticks)), switch, *[0.0] * 10))


def moved(pilot: SafetyPilot, switch: float) -> VehicleMode | None:
    """The position of the switch after enough frames."""
    for _ in range(CONFIRMATIONS):
        found = pilot.on_channels(channels(switch))
    assert found is not None
    return found.switch


def test_switch_moves_only_when_frames_in_row_agree() -> None:
    pilot = SafetyPilot(CrsfDriver())
    assert moved(pilot, 0.0) is None, "between both ends it is not known"
    assert moved(pilot, -1.0) is AUTO
    for _ in range(10):
        for position in (*[1.0] * (CONFIRMATIONS - 1), -1.0):
            found = pilot.on_channels(channels(position))
            assert found is not None
            assert (found.switch, found.sticks) == (AUTO, None)
    assert moved(pilot, 1.0) is MANUAL
    assert moved(pilot, 0.1) is MANUAL


def test_sticks_are_body_velocities_with_dead_band() -> None:
    pilot = SafetyPilot(CrsfDriver(speed_m_s=2.0, climb_m_s=1.0, turn_rad_s=0.5))
    moved(pilot, 1.0)
    found = pilot.on_channels(channels(1.0, 1.0, -1.0, 0.525, 0.04))
    assert found is not None
    assert found.sticks is not None
    assert (found.sticks.vx_m_s, found.sticks.vy_m_s, found.sticks.wz_rad_s) == (-2.0, -2.0, 0.0)
    assert found.sticks.vz_m_s == pytest.approx(0.5)
    found = pilot.on_channels(channels(1.0, 0.0, 0.0, 0.0, 1.0))
    assert found is not None
    assert found.sticks == Setpoint(0.0, 0.0, 0.0, -0.5)


def test_lost_transmitter_moves_nothing_and_keeps_switch() -> None:
    pilot = SafetyPilot(CrsfDriver())
    moved(pilot, 1.0)
    pilot.on_link(0.0)
    assert all(pilot.on_channels(channels(-1.0)) is None for _ in range(10))
    pilot.on_link(0.5)
    found = pilot.on_channels(channels(-1.0))
    assert found is not None
    assert found.switch is MANUAL
    assert moved(pilot, -1.0) is AUTO


@given(st.lists(st.lists(st.floats(-1, 1), min_size=16, max_size=16), max_size=20))
def test_any_sticks_are_within_the_limits(frames: list[list[float]]) -> None:
    config = CrsfDriver()
    pilot = SafetyPilot(config)
    moved(pilot, 1.0)
    for positions in frames:
        found = pilot.on_channels(RcChannels(tuple(positions)))
        if found is not None and found.sticks is not None:
            assert abs(found.sticks.vx_m_s) <= config.speed_m_s
            assert abs(found.sticks.wz_rad_s) <= config.turn_rad_s


async def test_sticks_are_published_and_garbage_is_named(tmp_path: Path) -> None:
    line = PseudoTerminal(tmp_path / "rc", lambda data: None)
    config = Config(drivers=(), retry_s=0.05, report_hz=50.0, failures=1)
    driver = CrsfReceiver(CrsfDriver(device=str(tmp_path / "rc"), rate_hz=50.0))
    async with running(tmp_path, [driver], config) as other:
        board = other.reader("hal/drivers", DriverTable)
        switch = other.reader("vehicle/switch", SafetySwitch)
        sticks = other.reader("vehicle/sticks", Setpoint)
        await status(board, "crsf", state="running")
        remote = other.reader("vehicle/remote", RemoteLink)
        assert remote.value == RemoteLink(False), "no frame of the transmitter yet"

        async def send_until(position: float, wanted: VehicleMode, noise: bytes = b"") -> None:
            async with asyncio.timeout(20.0):
                while switch.value is None or switch.value.mode is not wanted:
                    line.write(noise + link_frame(1.0) + channels_frame([0.0, 0.5, 0.0, 0.0, 0.0, position]))
                    await board.changed()

        await send_until(-1.0, AUTO)
        assert sticks.sequence == 0, "the navigator drives"
        assert remote.value == RemoteLink(True)
        line.write(link_frame(0.0))
        async with asyncio.timeout(20.0):
            while remote.value != RemoteLink(False):
                await board.changed()
        await send_until(1.0, MANUAL, noise=b"\x00\xc8")
        async with asyncio.timeout(20.0):
            while (found := sticks.value) is None:
                line.write(channels_frame([0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
                await board.changed()
        assert found.vx_m_s == pytest.approx((0.5 - 0.05) / 0.95 * 3.0, abs=0.02)
        failed = await status(board, "crsf", state="failed")
        assert "nothing valid for 1 s" in failed.note
        await send_until(-1.0, AUTO)
        line.close()
        await status(board, "crsf", state="waiting")
