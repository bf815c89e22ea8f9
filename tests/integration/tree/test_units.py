"""Two computers of one platform and a ground station: everything is reached by its path alone."""

import asyncio
from pathlib import Path

from tests.integration.tree.pair import SERVICES, on_uvloop, platforms, until
from tests.patience import PATIENCE_S, until_answer

from swarmware.model.access import Role
from swarmware.model.resource import Kind, Resource
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.module.streamwriter import StreamWriter
from swarmware.types.placement import PlacementRequest, UnitPlacement
from swarmware.types.scalar import Float, Int, Text
from swarmware.types.vehicle import Pose

GAIN = Resource(
    path="config/attitude/gain", kind=Kind.SETTING, type="Float", access="rw", default=2.5, range=(0.0, 9.0)
)


def answer(request: Text, meta: Meta) -> Text:
    who = "itself" if meta.sender is None else f"{meta.sender}:{Role(meta.sender.role).name}"
    return Text(f"{request.value} to {who}")


async def until_answered(module: Module, path: str) -> str:
    """The answer of a path, as soon as somebody is known to serve it."""
    return (await until_answer(lambda: module.request(path, Text("hello"), Text, timeout_s=1))).value


async def subscribed(writer: StreamWriter[Int], reader: StreamReader[Int]) -> None:
    """Returns when a reader receives what is written: a stream begins where its subscription does."""

    async def first_item() -> Int:
        writer.write(Int(-1))
        return await reader.next(0.2)

    await until_answer(first_item)


@on_uvloop
async def test_units_of_platform_reach_each_other_by_path(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "uav1.fc", "gcs") as (main, fc, gcs):
        # boards, both ways, and at another platform; each unit reads them at the same path
        attitude = fc.probe.writer("nav/attitude", Float, rate_hz=50, link="tick")
        goal = main.probe.writer("nav/goal_height", Float)
        attitude.write(Float(0.25))
        goal.write(Float(30.0))
        for reader in (
            main.probe.reader("nav/attitude", Float),
            main.probe.reader("/uav1/nav/attitude", Float),
            fc.probe.reader("nav/attitude", Float),
            gcs.probe.reader("/uav1/nav/attitude", Float),
        ):
            assert (await until(reader, lambda _: True)).value == 0.25
        for reader in (
            fc.probe.reader("nav/goal_height", Float),
            gcs.probe.reader("/uav1/nav/goal_height", Float),
        ):
            assert (await until(reader, lambda _: True)).value == 30.0

        # streams: each item, in order
        steps = main.probe.stream_reader("plan/steps", Int)
        seen = gcs.probe.stream_reader("/uav1/plan/steps", Int)
        written = fc.probe.stream_writer("plan/steps", Int, kind="event")
        await main.until_listed("/uav1/plan/steps", lambda entry: entry is not None)
        await gcs.until_listed("/uav1/plan/steps", lambda entry: entry is not None)
        for stream in (steps, seen):
            await subscribed(written, stream)
        for number in range(50):
            written.write(Int(number))
        for stream in (steps, seen):
            while (first := (await stream.next(PATIENCE_S)).value) < 0:
                pass
            assert [first, *[(await stream.next(PATIENCE_S)).value for _ in range(49)]] == list(range(50))

        # requests and messages: to whoever serves the path
        fc.probe.serve("cmd/attitude", Text, answer, reply=Text)
        main.probe.serve("cmd/plan", Text, answer, reply=Text)
        box = fc.probe.inbox("cmd/note", Text)
        assert await until_answered(fc.probe, "cmd/plan") == "hello to maintainer@uav1:MAINTAINER"
        assert await until_answered(main.probe, "cmd/attitude") == "hello to maintainer@uav1:MAINTAINER"
        assert await until_answered(main.probe, "/uav1/cmd/plan") == "hello to itself"
        assert await until_answered(gcs.probe, "/uav1/cmd/attitude") == "hello to maintainer@gcs:MAINTAINER"
        assert await gcs.probe.send("/uav1/cmd/note", Text("from gcs"), timeout_s=PATIENCE_S)
        assert await main.probe.send("cmd/note", Text("from main"), timeout_s=PATIENCE_S)
        assert [(await box.next(PATIENCE_S)).value for _ in range(2)] == ["from gcs", "from main"]

        # one tree: every node lists the resources of all units once, under the platform
        for node in (main, fc, gcs):
            await node.until_listed("/uav1/nav/goal_height", lambda entry: entry is not None)
            listed = await node.list("/uav1/nav/*")
            assert {"/uav1/nav/attitude", "/uav1/nav/goal_height"} <= listed.keys()
            assert not [path for path in await node.list("/**") if path.startswith("/uav1.fc/")]
        assert (await gcs.list("/uav1.fc/net/routes")).keys() == {"/uav1.fc/net/routes"}

        # values and settings of another unit, asked of the platform
        assert (await gcs.get("/uav1/nav/attitude", fresh=True)).source == "own"
        fc.probe.provide(GAIN)
        await gcs.until_listed("/uav1/config/attitude/gain", lambda entry: entry is not None)
        done = await gcs.set("/uav1/config/attitude/gain", 4.0)
        assert (done.path, done.version) == ("/uav1/config/attitude/gain", 1)
        gain = fc.probe.reader("config/attitude/gain", Float)
        assert (await until(gain, lambda value: value.value == 4.0)).value == 4.0


@on_uvloop
async def test_resources_of_killed_unit_return_with_it(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "uav1.fc", "gcs", start=False) as (main, fc, gcs):
        _, killed, _ = [await node.start(*SERVICES) for node in (main, fc, gcs)]
        pose = fc.probe.writer("nav/pose", Pose)
        pose.write(Pose(1.0, 2.0, 3.0))
        readers = {main: main.probe.reader("nav/pose", Pose), gcs: gcs.probe.reader("/uav1/nav/pose", Pose)}

        async def until_quality(*expected: str) -> None:
            for node, reader in readers.items():
                await until(reader, lambda value: value.x_m == 1.0)
                await node.until_listed(
                    "/uav1/nav/pose", lambda entry: entry is not None and entry.quality in expected
                )

        await until_quality("live", "stale")
        await killed.kill()
        await until_quality("lost")
        assert (await main.get("/uav1/nav/pose")).source == "mirror"
        await fc.start(*SERVICES)
        await until_quality("live", "stale")


@on_uvloop
async def test_each_computer_measures_its_received_resources(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "uav1.fc", "gcs") as (main, fc, gcs):
        attitude = fc.probe.writer("nav/attitude", Float, rate_hz=50, link="tick")
        attitude.write(Float(0.25))
        await until(main.probe.reader("nav/attitude", Float, within_s=0.25), lambda _: True)

        async def write_on() -> None:
            async for tick in fc.probe.every(0.02):
                attitude.write(Float(tick / 50))

        writing = asyncio.create_task(write_on())
        request = PlacementRequest(0.5)

        async def measured() -> UnitPlacement:
            return await gcs.probe.request(
                "/uav1.main/sys/tree/placement", request, UnitPlacement, timeout_s=PATIENCE_S
            )

        try:
            here = await measured()
            async with asyncio.timeout(PATIENCE_S):  # a busy computer may have written little meanwhile
                while not any(one.path == "nav/attitude" and one.values > 5 for one in here.inputs):
                    here = await measured()
            there = await gcs.probe.request(
                "/uav1.fc/sys/tree/placement", request, UnitPlacement, timeout_s=PATIENCE_S
            )
        finally:
            writing.cancel()
        (found,) = [one for one in here.inputs if one.path == "nav/attitude"]
        assert (here.unit, found.unit, found.within_s) == ("main", "fc", 0.25)
        assert found.applications == (main.probe.name,)
        assert found.payload_bytes > found.values
        assert found.delay_worst_ms is None, "without timesync the clocks of both are not compared"
        assert here.cores > 0
        assert here.busy_percent > 0
        assert {"broker", "tree"} <= {one.name for one in here.applications}
        assert "nav/attitude" not in {one.path for one in there.inputs}, "it is its own"
