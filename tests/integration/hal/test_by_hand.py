"""A vehicle as real processes: driven by one operator at a time, and killed without its drivers."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
from tests.patience import PATIENCE_S, until_value

from swarmware.errors import Denied
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.control import (
    ControlState,
    DriveEvent,
    DriveMode,
    DriveRequest,
    SafetySwitch,
    SwitchRequest,
)
from swarmware.types.mission import ManoeuvreRequest, MissionState, MissionStatus
from swarmware.types.vehicle import KillRequest, Pose, Setpoint, VehicleMode, VehicleState

T = TypeVar("T", bound=msgspec.Struct)

CHASSIS = ("sim", "hal")
DRIVERS = ("navigator", "mission", "health", "control")
DRIVE = "sys/vehicle/drive"


async def ask(m: Module, event: DriveEvent, *, take: bool = False) -> ControlState:
    return await m.request(DRIVE, DriveRequest(event, take), ControlState, timeout_s=PATIENCE_S)


async def send_until(
    m: Module, setpoint: Setpoint, board: BoardReader[T], right: Callable[[T], bool]
) -> None:
    """Sends a manual set-point at 10 Hz until the vehicle follows it."""
    delivered = 0
    async with asyncio.timeout(PATIENCE_S):
        async for _ in m.every(0.1):
            delivered += (await m.send("cmd/manual", setpoint, timeout_s=0.3)).delivered
            if delivered and board.value is not None and right(board.value):
                return


def test_vehicle_has_one_driver_and_dies_without_drivers(tmp_path: Path) -> None:
    async def drive() -> None:
        config = make_node(tmp_path)
        async with (
            spawn(config, *CHASSIS),
            spawn(config, *DRIVERS) as drivers,
            Module("anna", config_dir=config) as anna,
            Module("bert", config_dir=config) as bert,
        ):
            control = anna.reader("control/state", ControlState)
            mission = anna.reader("mission/state", MissionState)
            truth = anna.reader("sim/truth", Pose)
            vehicle = anna.reader("vehicle/state", VehicleState)
            await until_value(vehicle, lambda v: not v.armed)
            await until_value(anna.reader("nav/pose", Pose), lambda _: True)

            # a set-point without the stick moves nothing; the stick holds the mission
            up = ManoeuvreRequest("takeoff", {"altitude_m": 30.0, "speed_m_s": 2.0})
            await anna.request("sys/mission/manoeuvre", up, MissionStatus, timeout_s=PATIENCE_S)
            await until_value(truth, lambda pose: pose.z_m > 1.5)
            assert (await ask(anna, DriveEvent.DRIVE)).mode is DriveMode.MANUAL
            held = await until_value(mission, lambda state: state.held_by != "")
            assert held.held_by.startswith("anna")
            await send_until(anna, Setpoint(1.5), truth, lambda pose: pose.vx_m_s**2 + pose.vy_m_s**2 > 1.0)

            # two operators: the first has the stick, the other one takes it
            with pytest.raises(Denied, match="anna#1@uav1 has the stick; --take takes the stick"):
                await ask(bert, DriveEvent.DRIVE)
            assert (await ask(bert, DriveEvent.DRIVE, take=True)).holder.startswith("bert")
            with pytest.raises(Denied, match="bert#1@uav1 has the stick"):
                await ask(anna, DriveEvent.RELEASE)

            # silence: the vehicle holds, and its mission is still held
            await send_until(bert, Setpoint(-1.5), truth, lambda pose: pose.vx_m_s**2 + pose.vy_m_s**2 > 1.0)
            await until_value(control, lambda state: state.mode is DriveMode.HOLD)
            await until_value(truth, lambda pose: pose.vx_m_s**2 + pose.vy_m_s**2 < 0.01)
            assert mission.value is not None and mission.value.held_by.startswith("bert")

            # the safety pilot takes the vehicle from everybody, and the mission continues afterwards
            await anna.request(
                "sys/sim/switch", SwitchRequest(VehicleMode.MANUAL), SafetySwitch, timeout_s=PATIENCE_S
            )
            await until_value(control, lambda state: state.mode is DriveMode.PILOT)
            with pytest.raises(Denied, match="the safety pilot drives"):
                await ask(anna, DriveEvent.DRIVE, take=True)
            height_m = truth.value.z_m if truth.value else 0.0
            await anna.request(
                "sys/sim/switch", SwitchRequest(VehicleMode.AUTO), SafetySwitch, timeout_s=PATIENCE_S
            )
            await until_value(mission, lambda state: state.held_by == "")
            await until_value(truth, lambda pose: pose.z_m > height_m + 0.5)

            # navigator, mission, health and control die at once; the kill needs none of them
            await drivers.kill()
            killed = await anna.request(
                "sys/vehicle/kill", KillRequest("uav1", "test"), VehicleState, timeout_s=PATIENCE_S
            )
            assert not killed.armed
            await until_value(truth, lambda pose: pose.vz_m_s < -3.0)

    with no_leaks(tmp_path / "uav1/run", tmp_path / "uav1/shm"):  # the journal of the killed monitor stays
        asyncio.run(drive())
