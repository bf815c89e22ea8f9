"""A small swarm in one process: real nodes and mission daemons; radio, time and vehicles by the test."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import msgspec
import uvloop
from tests.patience import PATIENCE_S

from swarmd.mission.config import Config
from swarmd.mission.service import Mission
from swarmware.errors import Denied, NoAnswer
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id, hardware_id, join
from swarmware.module.board import BoardReader
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.module.writer import BoardWriter
from swarmware.node.node import Node
from swarmware.testing.leaks import no_leaks
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.sender import with_sender
from swarmware.types import registry
from swarmware.types.health import HealthState
from swarmware.types.mission import (
    MissionFile,
    MissionProgress,
    MissionState,
    MissionStatus,
    OrderReceipt,
)
from swarmware.types.navigation import Goal, NavError, NavState, NavStatus
from swarmware.types.rpc import Empty
from swarmware.types.time import Conversion, TimeFunctions
from swarmware.types.vehicle import ArmRequest, BatteryState, Pose, VehicleState

T = TypeVar("T", bound=msgspec.Struct)
P = ParamSpec("P")

STATE = "mission/state"
FAST = Config(
    # what is awaited here comes at once, or after a moment on a busy computer; what does not come is short
    leader_patience_s=0.2,
    position_patience_s=0.2,
    start_timeout_s=PATIENCE_S,
    order_timeout_s=PATIENCE_S,
    navigator_timeout_s=PATIENCE_S,
    blocked_patience_s=0.2,
)


def on_uvloop(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """The test on an event loop of its own, as services have it; it must leave nothing behind."""

    @wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        folders = [value for value in kwargs.values() if isinstance(value, Path)]
        with no_leaks(*folders), asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            runner.run(test(*args, **kwargs))

    return run


class FakeVehicle:
    """Motors and navigator of a vehicle that reaches every goal after a moment."""

    def __init__(self, module: Module, *, battery: float = 0.9) -> None:
        self.module = module
        self.battery = battery
        self.armed = False
        self.goals: list[Goal] = []
        self.answers: dict[str, str] = {}
        """State by goal kind, where it is not the usual one; after colons the error, and a note."""
        self.refuses_to_arm = False
        self.ready = asyncio.Event()
        """Arming waits for it at the gate."""
        self.ready.set()
        self.orders: asyncio.Queue[ArmRequest] = asyncio.Queue()
        self.landed = True
        self.took_s = 0.05

    def open(self) -> None:
        m = self.module
        self._state: BoardWriter[VehicleState] = m.writer("vehicle/state", VehicleState)
        self._status: BoardWriter[NavStatus] = m.writer("nav/status", NavStatus)
        pose: BoardWriter[Pose] = m.writer("nav/pose", Pose)
        battery: BoardWriter[BatteryState] = m.writer("power/battery", BatteryState)
        self.health: BoardWriter[HealthState] = m.writer("health/state", HealthState)
        self._state.write(VehicleState(False, True))
        battery.write(BatteryState(12.0, 1.0, self.battery))
        self.health.write(HealthState("ok"))
        pose.write(Pose.planar(0.0, 0.0))
        m.serve("sys/vehicle/arm", ArmRequest, self._arm, reply=VehicleState)
        m.start(self._navigate(), "navigate")
        m.start(self._live(pose), "live")

    async def _arm(self, request: ArmRequest, meta: Meta) -> VehicleState:
        self.orders.put_nowait(request)
        if request.armed:
            await self.ready.wait()
        if self.refuses_to_arm:
            raise Denied("safety switch: expected it off")
        self.armed = request.armed
        state = VehicleState(self.armed, self.landed)
        self._state.write(state)
        return state

    async def _live(self, pose: BoardWriter[Pose]) -> None:
        async for _ in self.module.every(0.2):
            pose.write(Pose.planar(0.0, 0.0))

    async def _navigate(self) -> None:
        goals = self.module.reader("nav/goal", Goal)
        goal = await goals.changed()
        while True:
            self.goals.append(goal)
            self._status.write(NavStatus(goal.seq, NavState.MOVING, 5.0, 3.0))
            await asyncio.sleep(self.took_s)
            usual = "holding" if goal.kind == "hold" else "arrived"
            state, error, note, *_ = [*self.answers.get(goal.kind, usual).split(":"), "", ""]
            seq = goal.seq + 5 if state == "elsewhere" else goal.seq
            goal = await self._repeat(NavStatus(seq, NavState(state), 0.0, 0.1, note, NavError(error)), goals)

    async def _repeat(self, status: NavStatus, goals: BoardReader[Goal]) -> Goal:
        """Says so ten times a second until there is another goal."""
        while True:
            self._status.write(status)
            with suppress(NoAnswer):
                return await goals.changed(0.1)


class Member:
    """One platform."""

    def __init__(self, node: Node, daemon: Module, vehicle: FakeVehicle | None) -> None:
        self.name = node.platform
        self.node = node
        self.daemon = daemon
        self._vehicle = vehicle
        self.task: asyncio.Task[None] | None = None
        self.history: list[str] = []
        """States of the mission, in order."""
        self.passed: dict[str, int] = {}
        """True instant at which each barrier was left."""

    @property
    def vehicle(self) -> FakeVehicle:
        assert self._vehicle is not None
        return self._vehicle

    @property
    def kinds(self) -> list[str]:
        """Kinds of the goals that the navigator was given."""
        return [goal.kind for goal in self.vehicle.goals]


class Swarm:
    """The members, and an operator's module at the ground station."""

    def __init__(self, members: dict[str, Member], operator: Module) -> None:
        self.members = members
        self.operator = operator
        self.changed = asyncio.Event()
        self.orders: list[OrderReceipt] = []
        self.arrived: dict[str, int] = {}
        """Platform → when the first request came off its link, on its clock."""
        self.answered: dict[str, list[str]] = {}
        """Platform → what it had stated of its mission when it first answered a request of others."""

    def __getitem__(self, name: str) -> Member:
        return self.members[name]

    async def ask(self, path: str, request: msgspec.Struct, reply: type[T]) -> T:
        return await self.operator.request(path, request, reply, timeout_s=PATIENCE_S)

    async def until(self, what: Callable[[], bool], timeout_s: float = PATIENCE_S) -> None:
        """Waits until it is so; looked at whenever a mission takes a step anywhere."""
        try:
            async with asyncio.timeout(timeout_s):
                while not what():
                    self.changed.clear()
                    await self.changed.wait()
        except TimeoutError as error:
            seen = {m.name: (m.history, list(m.passed)) for m in self.members.values()}
            raise AssertionError(f"not in {timeout_s:g} s: {seen}") from error

    def all_in(self, state: str, *but: str) -> bool:
        return all(m.history[-1:] == [state] for m in self.members.values() if m.name not in but)

    async def all_known(self, asker: str = "gcs") -> None:
        """Waits until the ground station has received all members."""
        boards = self.operator.readers("/*/mission/state", MissionState)
        path = join(asker, "sys/mission/status")
        async with asyncio.timeout(PATIENCE_S):
            while len((await self.ask(path, Empty(), MissionStatus)).others) < len(self.members) - 1:
                await boards.changed()

    async def kill(self, name: str) -> None:
        """Ends the daemon of a member without a word; its board falls silent."""
        task = self.members[name].task
        assert task is not None
        task.cancel()
        await asyncio.wait([task])


@asynccontextmanager
async def swarm(root: Path, *names: str, config: Config = FAST, **batteries: float) -> AsyncIterator[Swarm]:
    """Nodes with these names; the kind is the name without its number."""
    async with AsyncExitStack() as stack:
        members: dict[str, Member] = {}
        for number, name in enumerate(names):
            kind = name.rstrip("0123456789")
            clock = {"offset_s": 5.0 - 2.5 * number, "drift_ppm": 50.0 - 30.0 * number}
            node = await stack.enter_async_context(
                tmp_node(root, name, kind=kind, template="common", clock=clock)
            )
            vehicle = None
            if kind != "gcs":
                body = await stack.enter_async_context(Module("body", node=node))
                vehicle = FakeVehicle(body, battery=batteries.get(name, 0.9))
                vehicle.open()
            daemon = await stack.enter_async_context(Module("mission", node=node, config=config))
            members[name] = Member(node, daemon, vehicle)
        by_hardware = {hardware_id(name): member.node for name, member in members.items()}
        station = members.get("gcs") or next(iter(members.values()))
        operator = await stack.enter_async_context(Module("operator", node=station.node))
        found = Swarm(members, operator)
        for member in members.values():
            radio = await stack.enter_async_context(Module("radio", node=member.node))
            steps = radio.stream_reader("mission/progress", MissionProgress)
            member.node.messaging.set_gateway(partial(_carry, found, by_hardware, steps))
            _tell_time(radio, members)
            radio.start(_broadcast(radio, found, member), "broadcast")
            radio.start(_follow(radio, found, member), "follow")
        for member in members.values():
            member.task = asyncio.create_task(Mission(member.daemon, config).run())
            stack.push_async_callback(_end, member)
        receipts = operator.stream_reader("mission/orders", OrderReceipt)
        operator.start(_collect(receipts, found), "receipts")
        await found.all_known(station.name)
        yield found


async def _end(member: Member) -> None:
    task = member.task
    if task is not None:
        task.cancel()
        await asyncio.wait([task])
        if not task.cancelled() and (error := task.exception()) is not None:
            raise error


def _carry(
    found: Swarm, by_hardware: dict[int, Node], steps: StreamReader[MissionProgress], frame: Frame
) -> None:
    node = by_hardware.get(frame.receiver_hw)
    if node is None:
        return
    if frame.kind is FrameKind.REQUEST:
        arrived_ns = node.clock.now_ns()
        found.arrived.setdefault(node.platform, arrived_ns)
        frame.extension = with_sender(frame.extension, None, arrived_ns)
    elif frame.kind is FrameKind.REPLY and (sender := by_hardware.get(frame.sender_hw)) is not None:
        stated = [step.event for step in iter(steps.take, None)]
        # the first one: of a busy computer requests are repeated, and so are their answers
        found.answered.setdefault(sender.platform, stated)
    node.messaging.deliver(frame)


def _tell_time(radio: Module, members: dict[str, Member]) -> None:
    """Conversion functions as timesync would find them, without its error."""
    writer: BoardWriter[TimeFunctions] = radio.writer("time/functions", TimeFunctions)
    own, now_ns = radio.clock, radio.now_ns()
    functions = []
    for name, member in members.items():
        other = member.node.clock
        mono_ns = own.to_mono_ns(now_ns)
        later_ns = mono_ns + 1_000_000_000_000
        span_ns = own.from_mono_ns(later_ns) - now_ns
        ahead_ns = other.from_mono_ns(mono_ns) - now_ns
        gained_ns = other.from_mono_ns(later_ns) - own.from_mono_ns(later_ns) - ahead_ns
        functions.append(
            Conversion(
                name, "main", hardware_id(name), 1, ahead_ns, gained_ns / span_ns, now_ns, 1000, 100, 1e-9, 0
            )
        )
    writer.write(TimeFunctions(radio.platform, "main", 1, now_ns, tuple(functions)))


async def _broadcast(radio: Module, found: Swarm, member: Member) -> None:
    """The beacon: the state of a mission becomes a mirror at every other platform."""
    reader = radio.reader(STATE, MissionState)
    mirrors = {
        name: other.node.mirror_writer(member.name, STATE, slot_bytes=1024)
        for name, other in found.members.items()
        if name != member.name
    }
    try:
        async for state in reader:
            frame = Frame(FrameKind.BOARD, data_id(STATE, "MissionState"), hardware_id(member.name))
            frame.sequence, frame.stamp_ns = reader.sequence, reader.stamp_ns or 0
            frame.payload = registry.encode(state)
            for mirror in mirrors.values():
                mirror.publish(encode(frame))
    finally:
        for mirror in mirrors.values():
            mirror.close(unlink=True)


async def _follow(radio: Module, found: Swarm, member: Member) -> None:
    """The progress of a mission, for the test."""
    events = radio.stream_reader("mission/progress", MissionProgress)
    while True:
        try:
            step = await events.next()
        except NoAnswer:
            continue
        if not step.block:
            member.history.append(step.event.removeprefix("state:"))
        elif step.type == "Barrier" and step.event == "ok":
            member.passed[step.block] = radio.clock.to_mono_ns(step.at_ns)
        found.changed.set()


async def _collect(receipts: Any, found: Swarm) -> None:
    async for receipt in receipts:
        found.orders.append(receipt)


TASK = "sys/mission/task"


def hover(seconds: float) -> MissionFile:
    """Arm, meet, wait, meet."""
    return MissionFile(
        "hover.json",
        f"""{{"mission": {{
            "s": {{"type": "Start", "next": "arm"}},
            "arm": {{"type": "Arm", "next": "a"}},
            "a": {{"type": "Barrier", "id": "a", "timeout_s": 20, "next": "w"}},
            "w": {{"type": "Wait", "s": {seconds}, "next": "b"}},
            "b": {{"type": "Barrier", "id": "b", "timeout_s": 20, "next": "e"}},
            "e": {{"type": "End"}}
        }}}}""",
    )
