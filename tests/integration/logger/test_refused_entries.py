"""A database that refuses single entries stores the others; a database that refuses all is not
unreachable."""

from pathlib import Path
from typing import Any

import pytest
from pymongo import MongoClient
from tests.integration.logger.events import COUNT, events, fault, forwarded
from tests.integration.recorder.mongod import Mongod

from swarmware.module.module import Module
from swarmware.recorder.mongo import MongoStore
from swarmware.recorder.query import Query
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.log import LogStats
from swarmware.types.scalar import Int


@pytest.mark.mongod
async def test_refused_values_are_logged_and_total_refusal_faulted(
    tmp_path: Path,
) -> None:
    server = Mongod(tmp_path / "db")
    settings = {"flush_s": 0.1, "mongodb_uri": server.uri, "retry_s": 0.2}
    config = make_node(tmp_path, services={"logger": settings, "health": {}})
    server.start()
    client: MongoClient[dict[str, Any]] = MongoClient(server.uri)
    try:
        database = client["swarm"]
        frames = database.create_collection("frames", validator={"value.value": {"$ne": 7}})
        async with Module("source", config_dir=config) as module, spawn(config, "logger", "health") as logger:
            writer = events(module)
            stats = module.reader("log/stats", LogStats)
            for number in range(5, 10):
                writer.write(Int(number))
            await forwarded(stats, 5)
            assert "MongoDB refused 1 values since the start, the last one of /uav1/test/count (Int)" in (
                logger.stderr()
            )
            database.command("collMod", "frames", validator={"path": {"$ne": COUNT}})
            writer.write(Int(10))
            found = await fault(module)
            assert (found.state, found.level) == ("refused", "warn")
            assert "Document failed validation" in found.what
            database.command("collMod", "frames", validator={})
            await forwarded(stats, 6)
        seven = frames.find_one({"path": COUNT, "sequence": 3})
        assert seven is not None and (seven["value"], seven["reason"]) == (None, "Document failed validation")
        store = MongoStore(server.uri)
        entries = sorted(store.entries(Query(pattern=f"/uav1/{COUNT}")), key=lambda entry: entry.sequence)
        store.close()
        assert [entry.value() for entry in entries] == [Int(number) for number in range(5, 11)], (
            "the payload is stored, too"
        )
    finally:
        client.close()
        server.stop()
