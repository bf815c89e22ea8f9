"""Motor controllers on a CAN bus: frames as the firmware states them, and motors on a virtual bus."""

import asyncio
import struct
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.hal.rig import running
from tests.unit.hal.status import status

from swarmd.hal.buses.can import CanBus, CanFrame
from swarmd.hal.config import Config, VescDriver, VescMotor
from swarmd.hal.core.vesc import VescState, command
from swarmd.hal.driver import DeviceError, DeviceGone
from swarmd.hal.drivers.vesc import VescMotors
from swarmware.errors import WireError
from swarmware.types.driver import DriverTable
from swarmware.types.scalar import Float
from swarmware.types.vehicle import MotorControllerState, VehicleState

can = pytest.importorskip("can", reason="needs the extra can")

FAST = Config(drivers=(), retry_s=0.05, failures=2, report_hz=50.0)
LEFT = VescMotor(controller=1, path="act/left", state_path="sensor/left")
RIGHT = VescMotor(
    controller=2, path="act/right", state_path="sensor/right", quantity="speed", full_scale=-4000.0
)


class Controller:
    """A controller at the other end of a virtual bus: sends its status, keeps the last command."""

    def __init__(self, channel: str, number: int) -> None:
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.number = number
        self.commands: list[tuple[int, int]] = []

    def turn(self) -> None:
        """Sends a status and takes the commands that have arrived."""
        frames = [(9, struct.pack(">ihh", -3200, 125, -250)), (27, struct.pack(">ihh", 0, 242, 0)), (9, b"")]
        frames.append((16, struct.pack(">hhhh", 415, 300, 0, 0)))
        for kind, data in frames:
            self.bus.send(can.Message(arbitration_id=kind << 8 | self.number, data=data, is_extended_id=True))
        self.bus.send(can.Message(arbitration_id=9, data=b"", is_extended_id=False))
        while (message := self.bus.recv(0)) is not None:
            if message.arbitration_id & 0xFF == self.number and message.arbitration_id >> 8 < 9:
                value = struct.unpack(">i", message.data)[0]
                self.commands.append((message.arbitration_id >> 8, value))


@pytest.fixture
def controllers(tmp_path: Path) -> Iterator[list[Controller]]:
    made = [Controller(tmp_path.name, number) for number in (1, 2)]
    yield made
    for one in made:
        one.bus.shutdown()


def test_commands_have_the_form_of_the_firmware() -> None:
    assert command(1, "duty", 0.2) == (0x001, (20_000).to_bytes(4, "big"))
    assert command(7, "current", -1.5) == (0x107, (-1500).to_bytes(4, "big", signed=True))
    assert command(7, "speed", 1e12)[1] == b"\x7f\xff\xff\xff"


@given(st.integers(0, (1 << 29) - 1), st.binary(max_size=8))
def test_any_frame_is_state_absent_or_refused(identifier: int, data: bytes) -> None:
    state = VescState(identifier & 0xFF)
    try:
        found = state.on_frame(identifier, data)
    except WireError:
        return
    assert found is None or identifier >> 8 == 9


async def test_armed_motors_follow_and_publish_states(tmp_path: Path, controllers: list[Controller]) -> None:
    config = VescDriver(interface="virtual", device=tmp_path.name, motors=(LEFT, RIGHT))
    motors = VescMotors(config)
    async with running(tmp_path, [motors], FAST) as other:
        left, right = other.writer("act/left", Float), other.writer("act/right", Float)
        vehicle, board = other.writer("vehicle/state", VehicleState), other.reader("hal/drivers", DriverTable)

        async def drive(armed: bool, wanted: list[tuple[int, int]], *, setpoints: bool = True) -> None:
            vehicle.write(VehicleState(armed, landed=True))
            async with asyncio.timeout(20.0):
                while [one.commands[-1:] for one in controllers] != [[each] for each in wanted]:
                    if setpoints:
                        left.write(Float(0.5))
                        right.write(Float(0.25))
                    for one in controllers:
                        one.turn()
                    await board.changed()

        await drive(True, [(0, 25_000), (3, -1000)])
        await drive(False, [(1, 0), (1, 0)])
        await drive(True, [(0, 25_000), (3, -1000)])
        await drive(True, [(1, 0), (1, 0)], setpoints=False)
        assert motors.refused["status 9 of 0 bytes"] > 0
        state = await other.reader("sensor/left", MotorControllerState).changed(20.0)
        assert (state.speed_erpm, state.current_a, state.duty_ratio) == (-3200.0, 12.5, -0.25)
        assert (state.voltage_v, state.temperature_degc) == (24.2, 41.5)


async def test_silent_controller_is_named_and_found_again(
    tmp_path: Path, controllers: list[Controller]
) -> None:
    config = VescDriver(interface="virtual", device=tmp_path.name, motors=(LEFT, RIGHT))
    async with running(tmp_path, [VescMotors(config)], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        async with asyncio.timeout(30.0):
            table = await board.changed()
            while not table.drivers or table.drivers[0].state != "failed":
                controllers[0].turn()
                table = await board.changed()
        assert "controller 2: no status for more than 1 s" in table.drivers[0].note
        await status(board, "vesc", state="running")


async def test_absent_lost_or_unsupported_bus_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DeviceGone, match=r"socketcan:absent9: "):
        CanBus("socketcan", "absent9", lambda frame: None)
    with pytest.raises(DeviceGone, match=r"carrier-pigeon:a: "):
        CanBus("carrier-pigeon", "a", lambda frame: None)
    with patch.dict("sys.modules", {"can": None}), pytest.raises(DeviceError, match=r"swarmware\[can\]"):
        CanBus("virtual", "a", lambda frame: None)
    received = asyncio.Event()
    bus = CanBus("virtual", tmp_path.name, lambda frame: received.set())
    with (
        can.Bus(interface="virtual", channel=tmp_path.name) as sender,
        patch.object(bus._bus, "recv", side_effect=can.CanOperationError("Network is down")),
    ):
        sender.send(can.Message(arbitration_id=1, data=b"", is_extended_id=True))
        async with asyncio.timeout(20.0):
            while True:
                try:
                    bus.send(CanFrame(1, b""))
                except DeviceGone as error:
                    assert "lost: Network is down" in str(error)
                    break
                await asyncio.sleep(0)
    bus.close()
