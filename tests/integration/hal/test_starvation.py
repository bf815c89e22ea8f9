"""Real processes of one vehicle that are stopped, killed and kept from the processor in flight (ADR 69)."""

import asyncio
import math
import os
import re
import signal
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
from tests.integration.hal.nodes import pulsed_node
from tests.patience import PATIENCE_S

from swarmd.hal.config import Config as HalConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.errors import Denied, NoAnswer
from swarmware.geometry.attitude import to_euler
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import Process, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.health import CheckReport, CheckReports
from swarmware.types.mission import ManoeuvreRequest, MissionStatus
from swarmware.types.navigation import Goal, GoalKind, NavStatus
from swarmware.types.reaction import ReactionPhase, Reactions
from swarmware.types.vehicle import ArmRequest, Pose, VehicleState

T = TypeVar("T", bound=msgspec.Struct)
PARTS = ("sim", "hal", "control", "navigator")
HEIGHT_M = 5.0
LEVEL_RAD = 0.2
HELD_S = 1.0
"""`outputs_held_s` of the airframe."""
SETTLED_S = 2.0
"""Time after a pause within which the vehicle must be level."""


class Vehicle:
    """A vehicle whose daemons have a process each, holding its place."""

    def __init__(self, module: Module, parts: dict[str, Process]) -> None:
        self.parts = parts
        self.truth = module.reader("sim/truth", Pose)
        self.state = module.reader("vehicle/state", VehicleState)
        self.status = module.reader("nav/status", NavStatus)
        self.checks = module.reader("health/checks/hal", CheckReports)
        self.goals = module.writer("nav/goal", Goal)
        self.module = module

    @property
    def pose(self) -> Pose:
        assert self.truth.value is not None
        return self.truth.value

    @property
    def tilt_rad(self) -> float:
        pose = self.pose
        roll, pitch, _ = to_euler((pose.qx, pose.qy, pose.qz, pose.qw))
        return math.acos(math.cos(roll) * math.cos(pitch))

    @property
    def flies(self) -> bool:
        state = self.state.value
        return state is not None and state.armed and not state.landed

    def check(self, name: str) -> CheckReport:
        reports = self.checks.value
        assert reports is not None
        (found,) = (one for one in reports.reports if one.check == f"hal/flight/{name}")
        return found

    async def rise(self) -> None:
        await self.module.reader("nav/pose", Pose).changed(timeout_s=PATIENCE_S)
        async with asyncio.timeout(PATIENCE_S):
            while self.state.value is None or not self.state.value.armed:
                with suppress(Denied):  # until the attitude is known
                    await self.module.request(
                        "sys/vehicle/arm", ArmRequest(True), VehicleState, timeout_s=PATIENCE_S
                    )
        self.goals.write(Goal(1, GoalKind.TAKEOFF, z_m=HEIGHT_M, speed_m_s=2.0))
        await until(self.status, lambda s: s.goal_seq == 1 and s.state == "arrived")
        self.goals.write(Goal(2, GoalKind.HOLD))
        await until(self.status, lambda s: s.goal_seq == 2 and s.state == "holding")
        await until(self.checks, lambda _: self.check("loop").state == "ok")

    async def watch(self, duration_s: float) -> tuple[float, float]:
        """The lowest and the highest place in the next time, by each sample of the truth."""
        heights = [self.pose.z_m]
        end_s = time.monotonic() + duration_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            try:
                heights.append((await self.truth.changed(timeout_s=left_s)).z_m)
            except NoAnswer:
                break
        return min(heights), max(heights)

    async def pause(self, parts: tuple[str, ...], duration_s: float) -> None:
        """Stops processes for a time."""
        for part in parts:
            os.kill(self.parts[part].pid, signal.SIGSTOP)
        try:
            await asyncio.sleep(duration_s)
        finally:
            for part in parts:
                os.kill(self.parts[part].pid, signal.SIGCONT)

    async def fault(self) -> float:
        """Waits for the fault of the loop; the gap that it states."""
        await until(self.checks, lambda _: self.check("loop").state != "ok")
        found = re.match(r"(\d+\.\d+) s without a step", self.check("loop").freeze)
        assert found is not None, self.check("loop")
        return float(found[1])


async def until(board: BoardReader[T], right: Callable[[T], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while board.value is None or not right(board.value):
            await board.changed()


@asynccontextmanager
async def vehicle(root: Path, config_dir: Path | None = None) -> AsyncIterator[tuple[Vehicle, Path]]:
    """A vehicle in the air; `config_dir`: of another one than the simulated quadrotor."""
    if config_dir is None:
        services = {"sim": SimConfig(), "hal": HalConfig()}
        config_dir = make_node(root, "uav1", services=services, airframe="quad_1k5")
    async with AsyncExitStack() as stack:
        parts = {part: await stack.enter_async_context(spawn(config_dir, part)) for part in PARTS}
        module = await stack.enter_async_context(Module("test", config_dir=config_dir))
        found = Vehicle(module, parts)
        await found.rise()
        yield found, config_dir


@pytest.mark.parametrize(
    ("parts", "duration_s"),
    [(("hal",), 0.4), (("sim",), 0.4), (("hal",), 0.8), (PARTS, 0.4), (("hal",), 1.5)],
    ids=lambda value: "+".join(value) if isinstance(value, tuple) else str(value),
)
def test_stopped_process_is_fault_and_vehicle_levels_again(
    tmp_path: Path, parts: tuple[str, ...], duration_s: float
) -> None:
    async def fly() -> None:
        async with vehicle(tmp_path) as (flown, _):
            begin_m = flown.pose.z_m
            await flown.pause(parts, duration_s)
            lowest_m, highest_m = await flown.watch(SETTLED_S)
            gap_s = await flown.fault()
            assert gap_s >= duration_s - 0.05
            assert highest_m - begin_m < 1.0
            if gap_s <= HELD_S / 2:
                assert begin_m - lowest_m <= 0.5
            if gap_s <= HELD_S:
                assert flown.flies
                assert flown.tilt_rad < LEVEL_RAD
            level = flown.check("loop").level
            assert level == ("error" if gap_s >= HELD_S / 2 else "warn")
            _, highest_m = await flown.watch(3.0)
            assert highest_m - begin_m < 1.0

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_without_navigator_or_control_it_holds_its_height(tmp_path: Path) -> None:
    async def fly() -> None:
        async with vehicle(tmp_path) as (flown, _):
            for parts in (("navigator",), ("control",), ("navigator", "control")):
                begin_m = flown.pose.z_m
                await flown.pause(parts, 1.0)
                lowest_m, highest_m = await flown.watch(SETTLED_S)
                assert begin_m - lowest_m <= 0.5
                assert highest_m - begin_m < 1.0
                assert flown.flies
                assert flown.tilt_rad < LEVEL_RAD

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_restarted_flight_controller_continues_flight(tmp_path: Path) -> None:
    async def fly() -> None:
        async with vehicle(tmp_path) as (flown, config_dir):
            begin_m = flown.pose.z_m
            await flown.parts["hal"].kill()
            async with spawn(config_dir, "hal"):
                lowest_m, highest_m = await flown.watch(SETTLED_S)
                gap_s = await flown.fault()
                assert highest_m - begin_m < 1.0
                if gap_s <= HELD_S:
                    assert begin_m - lowest_m < 1.0
                    assert flown.flies
                    assert flown.tilt_rad < LEVEL_RAD

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_pulses_hold_during_driver_outage_then_end(tmp_path: Path) -> None:
    duty = tmp_path / "dev/pwmchip0/pwm0/duty_cycle"

    async def fly() -> None:
        async with vehicle(tmp_path, pulsed_node(tmp_path)) as (flown, config_dir):
            begin_m = flown.pose.z_m
            await flown.pause(("hal",), 0.6)
            lowest_m, highest_m = await flown.watch(SETTLED_S)
            gap_s = await flown.fault()
            assert highest_m - begin_m < 1.0
            if gap_s > HELD_S:
                pytest.skip(f"the processor was away for {gap_s} s")
            assert begin_m - lowest_m < 1.0
            assert flown.tilt_rad < LEVEL_RAD
            begin_m = flown.pose.z_m
            await flown.parts["hal"].kill()
            async with spawn(config_dir, "hal") as again:
                lowest_m, highest_m = await flown.watch(SETTLED_S)
                gap_s = await flown.fault()
                assert highest_m - begin_m < 1.0
                if gap_s > HELD_S:
                    pytest.skip(f"the processor was away for {gap_s} s")
                assert flown.flies
                assert begin_m - lowest_m < 1.5
                assert flown.tilt_rad < LEVEL_RAD
                os.kill(again.pid, signal.SIGSTOP)
                try:
                    async with asyncio.timeout(PATIENCE_S):
                        while duty.read_text() != "1000000\n":
                            await flown.truth.changed()
                finally:
                    os.kill(again.pid, signal.SIGCONT)

    with no_leaks(tmp_path):
        asyncio.run(fly())


def test_vehicle_whose_loop_was_away_lands_by_itself(tmp_path: Path) -> None:
    async def fly() -> None:
        services = {"sim": SimConfig(), "hal": HalConfig(), "mission": {}, "health": {}}
        config_dir = make_node(tmp_path, "uav1", services=services, airframe="quad_1k5")
        async with AsyncExitStack() as stack:
            names = (*PARTS, "health", "mission")
            parts = {part: await stack.enter_async_context(spawn(config_dir, part)) for part in names}
            module = await stack.enter_async_context(Module("test", config_dir=config_dir))
            pose, state = module.reader("nav/pose", Pose), module.reader("vehicle/state", VehicleState)
            reactions = module.reader("mission/reactions", Reactions)
            await pose.changed(timeout_s=PATIENCE_S)
            takeoff = ManoeuvreRequest("takeoff", {"altitude_m": HEIGHT_M, "speed_m_s": 2.0}, "test")
            await module.request("sys/mission/manoeuvre", takeoff, MissionStatus, timeout_s=PATIENCE_S)
            await until(pose, lambda at: at.z_m > HEIGHT_M - 0.5)
            os.kill(parts["hal"].pid, signal.SIGSTOP)
            await asyncio.sleep(0.7)
            os.kill(parts["hal"].pid, signal.SIGCONT)
            await until(
                reactions,
                lambda table: any(
                    r.row == "loop_late" and r.phase is ReactionPhase.ACTIVE for r in table.rows
                ),
            )
            await until(state, lambda now: now.resting)

    with no_leaks():  # the health monitor keeps its journal
        asyncio.run(fly())


@contextmanager
def processor_share(pid: int, ratio: float) -> Iterator[None]:
    """Limits a process to a share of one processor by a control group of either version."""
    period_us = 200_000
    version_1, version_2 = Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup")
    root = version_1 if (version_1 / "cpu.cfs_quota_us").exists() else version_2
    group = root / f"swarm-test-{pid}"
    try:
        group.mkdir()
        if root is version_1:
            (group / "cpu.cfs_period_us").write_text(f"{period_us}")
            (group / "cpu.cfs_quota_us").write_text(f"{round(ratio * period_us)}")
        else:
            (group / "cpu.max").write_text(f"{round(ratio * period_us)} {period_us}")
        former = Path(f"/proc/{pid}/cgroup").read_text().splitlines()
        (group / "cgroup.procs").write_text(f"{pid}")
    except OSError as error:
        if group.is_dir():
            group.rmdir()
        pytest.skip(f"no quota of processor time can be set here: {error}")
    try:
        yield
    finally:
        (place,) = (
            line.split(":", 2)[2]
            for line in former
            if ("cpu" in line.split(":")[1].split(",")) is (root is version_1)
        )
        (root / place.lstrip("/") / "cgroup.procs").write_text(f"{pid}")
        group.rmdir()


def processor_s(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("share", [0.8, 0.5])
def test_vehicle_with_processor_quota_stays_in_air(tmp_path: Path, share: float) -> None:
    """The quota of each 0.2 s is used up at once: the loop makes some steps and is stopped for the rest."""

    async def fly() -> None:
        async with vehicle(tmp_path) as (flown, _):
            hal = flown.parts["hal"].pid
            # the quota is a share of what the process needs, which depends on the processor
            used_s, began_s = processor_s(hal), time.monotonic()
            await flown.watch(4.0)
            ratio = share * (processor_s(hal) - used_s) / (time.monotonic() - began_s)
            begin_m = flown.pose.z_m
            with processor_share(hal, ratio):
                lowest_m, highest_m = await flown.watch(8.0)
                gap_s = await flown.fault()
            if gap_s <= HELD_S / 2:
                assert begin_m - lowest_m < 1.5
                assert highest_m - begin_m < 1.0
            await flown.watch(SETTLED_S)
            if gap_s <= HELD_S / 2:
                assert flown.flies
                assert flown.tilt_rad < LEVEL_RAD

    with no_leaks(tmp_path):
        asyncio.run(fly())
