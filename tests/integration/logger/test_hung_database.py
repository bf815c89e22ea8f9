"""A database that hangs: the logger continues, reports it, ends in time, and stores each entry once later."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import tomli_w
from tests.integration.logger.events import COUNT, counted, events, fault, flushed, forwarded
from tests.integration.recorder.mongod import Mongod

from swarmware.module.module import Module
from swarmware.recorder.mongo import MongoStore
from swarmware.recorder.query import Query
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.log import LogStats
from swarmware.types.scalar import Int

HUNG_S = 60.0
"""An answer that is waited for longer than the test waits for anything."""


@asynccontextmanager
async def silent_server() -> AsyncIterator[str]:
    """Accepts connections and reads their data, but never answers."""

    async def swallow(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError):
            await reader.read()
        writer.close()

    server = await asyncio.start_server(swallow, "127.0.0.1", 0)
    async with server:
        yield f"mongodb://127.0.0.1:{server.sockets[0].getsockname()[1]}"


async def test_unanswering_server_is_fault_and_local_log_continues(
    tmp_path: Path,
) -> None:
    async with silent_server() as uri:
        logger = {"flush_s": 0.1, "mongodb_uri": uri, "answer_s": 0.3}
        config = make_node(tmp_path, services={"logger": logger, "health": {}})
        async with Module("source", config_dir=config) as module, spawn(config, "logger", "health"):
            writer = events(module)
            writer.write(Int(1))
            found = await fault(module)
            assert (found.state, found.level) == ("slow", "warn")
            writer.write(Int(2))
            stats = await flushed(module)
            assert stats.mongodb.startswith("away: ")
            assert stats.backlog >= 2
        assert counted(tmp_path / "uav1/data/log") == [1, 2]


async def test_server_after_hang_gets_everything_once(
    tmp_path: Path,
) -> None:
    server = Mongod(tmp_path / "db")
    settings = {"flush_s": 0.1, "mongodb_uri": server.uri, "retry_s": 0.2, "answer_s": 0.5}
    config = make_node(tmp_path, services={"logger": settings, "health": {}})
    log = tmp_path / "uav1/data/log"
    try:
        server.start()
        async with Module("source", config_dir=config) as module:
            writer = events(module, slots=512)
            stats = module.reader("log/stats", LogStats)
            async with spawn(config, "logger", "health"):
                writer.write(Int(0))
                await forwarded(stats, 1)
                server.freeze()
                for number in range(1, 200):
                    writer.write(Int(number))
                assert (await fault(module)).state in ("slow", "unreachable")
                await flushed(module)
                assert counted(log) == list(range(200))
                server.thaw()
                await forwarded(stats, 200)
            (config / "services" / "logger.toml").write_text(tomli_w.dumps(settings | {"answer_s": HUNG_S}))
            async with spawn(config, "logger") as logger:
                writer.write(Int(200))
                await forwarded(stats, 1)
                server.freeze()
                for number in range(201, 300):
                    writer.write(Int(number))
                await flushed(module)
                began_s = time.monotonic()
                assert await logger.terminate() == 0
                assert time.monotonic() - began_s < HUNG_S / 2
            server.thaw()
            async with spawn(config, "logger"):
                await forwarded(stats, 99)
        store = MongoStore(server.uri)
        found = [entry.value() for entry in store.entries(Query(pattern=f"/uav1/{COUNT}"))]
        store.close()
        assert found == [Int(number) for number in range(300)]
    finally:
        server.stop()
