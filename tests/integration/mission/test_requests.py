"""Blocks that ask other modules, played by the real daemon; the published mission with stub services."""

import asyncio
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.integration.mission.swarm import TASK, Swarm, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmware.errors import Denied, NotFound
from swarmware.module.meta import Meta
from swarmware.types.health import (
    GuardStatus,
    ServiceState,
    StartOrder,
    StopOrder,
    SupervisorKind,
    WatchedService,
)
from swarmware.types.mission import (
    BreakpointAnswer,
    MissionFile,
    MissionState,
    MissionStatus,
    MissionTask,
    TaskAnswer,
)
from swarmware.types.registry import register
from swarmware.types.rpc import Empty
from swarmware.types.tree import TreeSet, TreeSetDone
from swarmware.types.vehicle import ArmRequest, Barometer, VehicleState

PUBLISHED = Path(__file__).parents[2] / "data" / "bdl" / "mission1.json"


@register
class FlyTo(msgspec.Struct, frozen=True, array_like=True):
    """Arguments of the actions of the published mission."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


class Stubs:
    """Services of a platform that a mission asks; what they were asked, in order."""

    def __init__(self, s: Swarm, *services: str) -> None:
        self.asked: list[tuple[str, msgspec.Struct]] = []
        self.states = dict.fromkeys(services, ServiceState.STOPPED)
        module = s["uav1"].vehicle.module
        self.module = module
        module.serve("sys/guard/start", StartOrder, self._start, reply=GuardStatus)
        module.serve("sys/guard/stop", StopOrder, self._stop, reply=GuardStatus)
        module.serve("sys/guard/status", Empty, self._status, reply=GuardStatus)

    def command(self, path: str, request: type[msgspec.Struct], answer: msgspec.Struct) -> None:
        def handle(value: msgspec.Struct, _meta: Meta) -> msgspec.Struct:
            self.asked.append((path, value))
            return answer

        self.module.serve(path, request, handle, reply=type(answer))

    def _start(self, order: StartOrder, meta: Meta) -> GuardStatus:
        self.asked.append(("start", order))
        self.states[order.service] = ServiceState.STARTING
        return self._status(Empty(), meta)

    def _stop(self, order: StopOrder, meta: Meta) -> GuardStatus:
        if order.service == "broker":
            raise Denied("service 'broker': the node is reached through it")
        self.asked.append(("stop", order))
        self.states[order.service] = ServiceState.STOPPED
        return self._status(Empty(), meta)

    def _status(self, _request: Empty, _meta: Meta) -> GuardStatus:
        services = tuple(WatchedService(name, state) for name, state in self.states.items())
        # what starts runs by the next question
        for name, state in self.states.items():
            if state == ServiceState.STARTING:
                self.states[name] = ServiceState.RUNNING
        return GuardStatus(SupervisorKind.SELF, services)


async def play(s: Swarm, *blocks: dict[str, Any]) -> str:
    """Plays the blocks one after the other; the state at the end, with its reason."""
    found: dict[str, Any] = {"s": {"type": "Start", "next": "b1"}}
    for number, block in enumerate(blocks, 1):
        found[f"b{number}"] = {"next": f"b{number + 1}", **block}
    found[f"b{len(blocks) + 1}"] = {"type": "End"}
    text = msgspec.json.encode({"mission": found}).decode()
    await task(s, text)
    ends = {"done", "failed", "aborted"}
    await s.until(lambda: s["uav1"].history[-1:] != [] and s["uav1"].history[-1] in ends)
    state = (await s.ask("/uav1/sys/mission/status", Empty(), MissionStatus)).state
    return f"{state.state}: {state.text}"


async def task(s: Swarm, text: str) -> None:
    """Orders a mission of uav1 alone."""
    order = MissionTask("asks", (MissionFile("asks.json", text),), members=("uav1",))
    s["uav1"].history.clear()
    assert (await s.ask(TASK, order, TaskAnswer)).accepted


@on_uvloop
async def test_published_mission_plays_with_stub_services(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        stubs = Stubs(s, "coppternode1", "swarm_communication", "loggernode1")
        for path in ("copternode1/arm", "copternode1/disarm"):
            stubs.command(path, Empty, Empty())
        for path in ("loggernode1/start_logging", "loggernode1/stop_logging"):
            stubs.command(path, Empty, Empty())
        for path in ("copternode1/takeoff", "copternode1/fly_to", "copternode1/land"):
            stubs.command(path, FlyTo, VehicleState(True, False))
        await task(s, PUBLISHED.read_text())
        await s.until(lambda: "running" in s["uav1"].history)
        stubs.module.writer("sensors/temperature/air", Barometer).write(Barometer(101_325.0, 20.0))
        await s.until(lambda: s["uav1"].history[-1:] == ["done"])
        started = {order.service for path, order in stubs.asked if isinstance(order, StartOrder)}
        assert started == {"coppternode1", "swarm_communication", "loggernode1"}
        assert [path for path, order in stubs.asked if not isinstance(order, StartOrder)] == [
            "copternode1/arm",
            "copternode1/takeoff",
            "loggernode1/start_logging",
            "copternode1/fly_to",
            "copternode1/fly_to",
            "loggernode1/stop_logging",
            "copternode1/land",
            "copternode1/disarm",
        ]
        heights = [order.z_m for _, order in stubs.asked if isinstance(order, FlyTo)]
        assert heights == [1.0, 100.0, 1.0, 1.0]


@on_uvloop
async def test_request_has_typed_arguments_and_checks_its_answer(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        stubs = Stubs(s)
        stubs.command("cargo/ready", ArmRequest, VehicleState(False, True))
        asks = {"type": "Request", "path": "cargo/ready"}
        named = {**asks, "args": {"armed": True, "reason": "test"}, "expect": "landed == true"}
        assert await play(s, named) == "done: done"
        assert stubs.asked == [("cargo/ready", ArmRequest(True, reason="test"))]
        assert "expected armed == true" in await play(s, {**named, "expect": "armed == true"})
        assert "error:refused" in await play(s, {**asks, "args": {"armd": True}})
        assert "error:not_found" in await play(s, {**asks, "path": "cargo/away"})
        assert "expected a command" in await play(s, {**asks, "path": "nav/pose"})


@on_uvloop
async def test_cut_off_request_says_that_nothing_answered(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        stubs = Stubs(s)
        never = asyncio.Event()

        async def handle(_request: Empty, _meta: Meta) -> Empty:
            await never.wait()
            return Empty()

        stubs.module.serve("cargo/slow", Empty, handle, reply=Empty)
        asks = {"type": "Request", "path": "cargo/slow", "answer_s": 0.2}
        assert "error:no_answer" in await play(s, asks)
        never.set()


@on_uvloop
async def test_resource_is_set_by_tree(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        stubs = Stubs(s)
        stubs.command("sys/tree/set", TreeSet, TreeSetDone("/uav1/light/level", 1, "Scalar", b""))
        assert await play(s, {"type": "SetResource", "path": "light/level", "value": 0.5}) == "done: done"
        ((_, order),) = stubs.asked
        assert isinstance(order, TreeSet)
        assert (order.path, msgspec.msgpack.decode(order.value)) == ("light/level", 0.5)


@on_uvloop
async def test_services_are_started_and_stopped_by_guard(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        stubs = Stubs(s, "camera")
        start, stop = {"type": "StartModule", "service": "camera"}, {"type": "StopModule"}
        assert await play(s, start) == "done: done"
        assert stubs.states == {"camera": ServiceState.RUNNING}
        assert await play(s, {**stop, "service": "camera"}) == "done: done"
        assert stubs.states == {"camera": ServiceState.STOPPED}
        assert "error:refused" in await play(s, {**stop, "service": "broker"})
        # an armed vehicle keeps the services with which it moves
        stubs.states["navigator"] = ServiceState.RUNNING
        armed = await play(s, {"type": "Arm"}, {**stop, "service": "navigator"})
        assert "the armed vehicle flies with navigator" in armed
        assert stubs.states["navigator"] == ServiceState.RUNNING


async def asking(s: Swarm, question: str) -> None:
    """Waits until the state of the vehicle's mission shows the question."""
    states = s.operator.reader("/uav1/mission/state", MissionState)
    async with asyncio.timeout(PATIENCE_S):
        while (state := states.value) is None or question not in state.text:
            await states.changed()


@on_uvloop
async def test_breakpoint_waits_for_answer_of_operator(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        asks = {"type": "UserBreakpoint"}
        path = "/uav1/sys/mission/answer"
        with pytest.raises(NotFound, match="no block waits"):
            await s.ask(path, BreakpointAnswer(True), Empty)
        for proceed, end in ((True, "done: done"), (False, "error:stopped")):
            question = f"Ready for {end}?"
            playing = asyncio.create_task(play(s, {**asks, "question": question}))
            await asking(s, f"{question} (mission answer uav1)")
            with pytest.raises(NotFound, match="expected one of b1"):
                await s.ask(path, BreakpointAnswer(True, "b9"), Empty)
            await s.ask(path, BreakpointAnswer(proceed), Empty)
            assert end in await playing


@on_uvloop
async def test_breakpoint_without_answer_follows_the_mission(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        asks = {"type": "UserBreakpoint", "question": "Ready?", "wait_s": 0.1}
        assert await play(s, {**asks, "unanswered": "continue"}) == "done: done"
        assert "error:stopped: Ready? no answer within 0.1 s" in await play(s, asks)
