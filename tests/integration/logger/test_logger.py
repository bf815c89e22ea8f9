"""The logger as a real process: each value in shared memory is on disk once, also after kill -9."""

import statistics
from itertools import pairwise
from pathlib import Path

from tests.integration.logger.events import COUNT, counted, events, flushed, forwarded
from tests.integration.recorder.mongod import Mongod
from tests.patience import PATIENCE_S

from swarmware.module.module import Module
from swarmware.recorder.query import FolderSource, Query
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.log import LogGap, LogStats
from swarmware.types.mission import MissionAbort
from swarmware.types.scalar import Float, Int, Text
from swarmware.types.vehicle import ArmRequest, VehicleState


async def test_killed_logger_logs_every_event_once(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"logger": {"flush_s": 0.1}})
    log = tmp_path / "uav1/data/log"
    async with Module("source", config_dir=config) as module:
        writer = events(module, slots=512)
        for number in range(100):
            writer.write(Int(number))  # before there is a logger
        async with spawn(config, "logger") as logger:
            await flushed(module)
            assert counted(log) == list(range(100))
            for number in range(100, 200):
                writer.write(Int(number))
            await flushed(module)
            for number in range(200, 250):
                writer.write(Int(number))
            await logger.kill()
        for number in range(250, 300):
            writer.write(Int(number))  # while there is no pid
        async with spawn(config, "logger"):
            stats = await flushed(module)
            assert counted(log) == list(range(300))
            assert stats.gaps == 0


async def test_overwritten_events_are_gap_with_number(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"logger": {"period_s": 1.0}})
    log = tmp_path / "uav1/data/log"
    async with Module("source", config_dir=config) as module:
        writer = events(module, slots=16)
        async with spawn(config, "logger"):
            writer.write(Int(0))
            await flushed(module)
            for number in range(1, 201):
                writer.write(Int(number))
            stats = await flushed(module)
        numbers = counted(log)
        assert numbers[-1] == 200
        gaps = [
            value
            for entry in FolderSource([log]).entries(Query(pattern="/uav1/log/gaps"))
            if isinstance(value := entry.value(), LogGap)
        ]
        assert sum(gap.count for gap in gaps) == 201 - len(numbers) == stats.gaps
        assert {(gap.where, gap.path) for gap in gaps} == {("ring", COUNT)}


async def test_board_is_decimated_to_rate_of_its_descriptor(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"logger": {"period_s": 0.02}})
    log = tmp_path / "uav1/data/log"
    async with Module("source", config_dir=config) as module, spawn(config, "logger"):
        writer = module.writer("test/level", Float, rate_hz=50.0, log="5hz")
        ticks = 0
        async for _ in module.every(0.02):
            writer.write(Float(float(ticks)))
            ticks += 1
            if ticks == 100:
                break
        await flushed(module)
        stamps = [entry.stamp_ns for entry in FolderSource([log]).entries(Query(pattern="/uav1/test/level"))]
        gaps_s = [(later - former) / 1e9 for former, later in pairwise(stamps)]
        assert 0.1 < statistics.median(gaps_s) < 0.4, "one stall of a busy machine is one gap of many"


async def test_board_is_followed_beyond_its_former_ring(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"logger": {"period_s": 0.02}})
    log = tmp_path / "uav1/data/log"
    texts = ["short", "x" * 5000, "y" * 20_000]
    async with Module("source", config_dir=config) as module, spawn(config, "logger"):
        writer = module.writer("test/text", Text, log="all")
        for text in texts:
            writer.write(Text(text))
            await flushed(module)
    found = [entry.value() for entry in FolderSource([log]).entries(Query(pattern="/uav1/test/text"))]
    assert found == [Text(text) for text in texts]


async def test_late_or_interrupted_database_gets_everything_once(tmp_path: Path) -> None:
    server = Mongod(tmp_path / "db")
    logger_settings = {
        "flush_s": 0.1,
        "mongodb_uri": f"{server.uri}/?serverSelectionTimeoutMS=300",
        "retry_s": 0.2,
        "forward_batch": 50,
    }
    config = make_node(tmp_path, services={"logger": logger_settings})
    try:
        async with Module("source", config_dir=config) as module, spawn(config, "logger"):
            writer = events(module, slots=512)
            stats = module.reader("log/stats", LogStats)
            for number in range(200):
                writer.write(Int(number))
            await flushed(module)
            server.start()
            await forwarded(stats, 200)
            server.kill()
            for number in range(200, 400):
                writer.write(Int(number))
            await flushed(module)
            server.start()
            await forwarded(stats, 400)
        from swarmware.recorder.mongo import MongoStore

        store = MongoStore(server.uri)
        found = [entry.value() for entry in store.entries(Query(pattern=f"/uav1/{COUNT}"))]
        store.close()
        assert found == [Int(number) for number in range(400)]
    finally:
        server.stop()


async def test_commands_are_recorded_once_with_their_sender(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"logger": {"flush_s": 0.1}})
    log = tmp_path / "uav1/data/log"
    async with (
        Module("mission", config_dir=config) as mission,
        Module("hal", config_dir=config) as hal,
        Module("operator", config_dir=config) as operator,
        spawn(config, "logger"),
    ):
        aborts = mission.inbox("cmd/abort", MissionAbort)
        armed = VehicleState(True, True)
        hal.serve("sys/vehicle/arm", ArmRequest, lambda *_: armed, reply=VehicleState)
        operator.inbox("test/private", Text)  # the template does not log it
        for number in range(3):
            assert await operator.send("cmd/abort", MissionAbort(reason=f"no {number}"), timeout_s=PATIENCE_S)
        await operator.request("sys/vehicle/arm", ArmRequest(True), VehicleState, timeout_s=PATIENCE_S)
        await operator.send("test/private", Text("x"), timeout_s=PATIENCE_S)
        assert (await aborts.next(PATIENCE_S)).reason == "no 0"
        await flushed(operator)
        entries = list(FolderSource([log]).entries(Query(pattern="/*/{cmd,sys,test}/**")))
    found = [(entry.queue, entry.path, entry.kind, entry.sender) for entry in entries]
    assert found == [
        *[("uav1:mission:in", "cmd/abort", "command", "operator#1@uav1")] * 3,
        ("uav1:hal:in", "sys/vehicle/arm", "command", "operator#1@uav1"),
    ]
    assert [entry.sequence for entry in entries] == [1, 2, 3, 1]
    aborted = [value.reason for entry in entries if isinstance(value := entry.value(), MissionAbort)]
    assert aborted == ["no 0", "no 1", "no 2"]


async def test_remains_of_departed_writer_are_logged(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"logger": {"period_s": 0.5}})
    log = tmp_path / "uav1/data/log"
    async with Module("source", config_dir=config) as module, spawn(config, "logger"):
        writer = events(module, slots=512)
        writer.write(Int(0))
        await flushed(module)
        for number in range(1, 101):
            writer.write(Int(number))
        module.close_writer(writer)
        stats = await flushed(module)
    assert len(counted(log)) + stats.gaps == 101
    assert counted(log) == list(range(101))


async def test_invalid_database_address_is_reported_without_password(
    tmp_path: Path,
) -> None:
    settings = {"mongodb_uri": "mongodb://swarm:secret@/nowhere:x"}
    config = make_node(tmp_path, services={"logger": settings})
    async with Module("source", config_dir=config) as module, spawn(config, "logger") as logger:
        writer = events(module)
        writer.write(Int(7))
        while not (stats := await flushed(module)).mongodb.startswith(
            "off: mongodb_uri 'mongodb://swarm:***@"
        ):
            assert stats.mongodb == "off", "the address was not looked at yet"
        said = logger.stderr()
    assert "Traceback" not in said and "secret" not in said
    assert "forwarding is off" in said
    assert counted(tmp_path / "uav1/data/log") == [7]
