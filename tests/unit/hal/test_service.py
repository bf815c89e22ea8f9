"""The service under its drivers: own rates, own threads, failures, the fail-safe of an actuator."""

import asyncio
import threading
from pathlib import Path

import pytest
from tests.unit.hal.rig import running
from tests.unit.hal.status import Counter, state_of, status

from swarmd.hal.blocking import BlockingDevice, BlockingSensor
from swarmd.hal.config import Config
from swarmd.hal.driver import Actuator
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.driver import DriverTable
from swarmware.types.health import CheckReports

FAST = Config(drivers=(), retry_s=0.05, failures=2, report_hz=50.0)


class Stuck(BlockingSensor[int]):
    """A device that blocks its reader until it is released."""

    name = "stuck"
    period_s = 0.01

    def __init__(self) -> None:
        self.begun, self.released = threading.Event(), threading.Event()
        self.threads: list[str] = []

    def measure(self) -> int:
        self.threads.append(threading.current_thread().name)
        self.begun.set()
        self.released.wait()
        if len(self.threads) == 2:
            raise OSError("no answer")
        return 7

    def publish(self, value: int, now_ns: int) -> bool:
        return value == 7


class Valve(Actuator):
    """An actuator whose set-points stop arriving."""

    name, period_s = "valve", 0.01
    starved = False

    async def write(self, now_ns: int) -> bool:
        return not self.starved

    def failsafe(self, now_ns: int) -> str:
        return "no set-point" if self.starved else ""


async def test_each_driver_has_its_own_rate(tmp_path: Path) -> None:
    devices = [Counter("slow", 20.0), Counter("imu", 300.0), Valve()]
    async with running(tmp_path, devices, FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        async with asyncio.timeout(20.0):
            while True:
                table = {driver.name: driver for driver in (await board.changed()).drivers}
                if table["slow"].reads >= 10:
                    break
        assert [one.asked_hz for one in table.values()] == [20.0, 300.0, 100.0]
        assert [one.actuator for one in table.values()] == [False, False, True]
        # at whatever speed of the computer: each period was used or counted
        slow, imu = (table[name].reads + table[name].missed for name in ("slow", "imu"))
        assert imu == pytest.approx(15 * slow, abs=30)


async def test_blocking_device_has_thread_and_delays_none(tmp_path: Path) -> None:
    stuck, counter = Stuck(), Counter("counter", 100.0)
    async with running(tmp_path, [stuck, counter], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        await asyncio.to_thread(stuck.begun.wait)
        before = (await status(board, "counter")).reads
        async with asyncio.timeout(20.0):
            while (await status(board, "counter")).reads < before + 20:
                assert (await status(board, "stuck")).reads == 0
        stuck.released.set()
        failed = await status(board, "stuck", errors=1)
        assert failed.note == "no answer", "an error in the thread is one of the driver"
        async with asyncio.timeout(20.0):
            while (await status(board, "stuck")).reads < 3:
                pass
        assert set(stuck.threads) == {"hal-stuck"}


async def test_hanging_device_does_not_block_end(tmp_path: Path) -> None:
    stuck = Stuck()
    async with running(tmp_path, [stuck], FAST):
        await asyncio.to_thread(stuck.begun.wait)
    assert not stuck.released.is_set(), "the service ended while its device still hangs"
    stuck.released.set()


async def test_unplugged_device_is_fault_until_it_is_back(tmp_path: Path) -> None:
    counter = Counter("gnss.left", 100.0)
    async with running(tmp_path, [counter], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        await status(board, "gnss.left", state="running")
        counter.plugged = False
        assert (await status(board, "gnss.left", state="waiting")).note == "gnss.left is unplugged"
        checks = other.reader("health/checks/hal", CheckReports)
        assert await state_of(checks, "hal/driver/gnss/left", "unplugged")
        counter.plugged = True
        await status(board, "gnss.left", state="running")
        assert counter.opened == 2
        assert await state_of(checks, "hal/driver/gnss/left", "ok")


async def test_fail_safe_of_actuator_is_shown_and_reported(tmp_path: Path) -> None:
    valve = Valve()
    async with running(tmp_path, [valve], FAST) as other:
        board = other.reader("hal/drivers", DriverTable)
        await status(board, "valve", state="running")
        valve.starved = True
        assert (await status(board, "valve", state="failsafe")).note == "no set-point"
        checks = other.reader("health/checks/hal", CheckReports)
        assert await state_of(checks, "hal/failsafe/valve", "failsafe")
        shown = checks.value
        assert shown is not None
        assert next(r.level for r in shown.reports if r.check == "hal/failsafe/valve") == "warn"
        valve.starved = False
        assert (await status(board, "valve", state="running")).note == ""
        assert await state_of(checks, "hal/failsafe/valve", "ok")


async def test_fail_safe_check_exists_before_need(tmp_path: Path) -> None:
    async with running(tmp_path, [Valve()], FAST) as other:
        checks = other.reader("health/checks/hal", CheckReports)
        assert await state_of(checks, "hal/failsafe/valve", "ok")


class SlowToClose(BlockingDevice):
    """A device whose last call takes long."""

    name = "slow"
    period_s = 1.0

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.closing, self.released = threading.Event(), threading.Event()

    def connect(self) -> None:
        self.calls.append("connect")

    def disconnect(self) -> None:
        self.closing.set()
        self.released.wait()
        self.calls.append("disconnect")


async def test_device_reopens_after_its_last_call_ended(tmp_path: Path) -> None:
    device = SlowToClose()
    async with tmp_node(tmp_path) as node, Module("hal", node=node) as module:
        await device.open(module)
        await device.close()
        again = asyncio.create_task(device.open(module), name="again")
        await asyncio.to_thread(device.closing.wait)
        done, _ = await asyncio.wait([again], timeout=0.05)
        device.released.set()
        await again
        assert not done
        assert device.calls == ["connect", "disconnect", "connect"]
        await device.close()
