"""The local ring and MongoDB give the same answers; a database that goes away costs nothing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mongomock
import pytest
from pymongo import MongoClient
from tests.integration.record.mongod import Mongod

from swarmd.logger.forward import Forwarder
from swarmware.errors import ConfigError, NoAnswer
from swarmware.record.entry import Entry
from swarmware.record.mongo import MongoStore, to_document
from swarmware.record.query import FolderSource, Query, Source
from swarmware.record.ring import LogRing
from swarmware.record.segment import Channel
from swarmware.types import registry
from swarmware.types.scalar import Text
from swarmware.types.vehicle import BatteryState, Pose

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


@pytest.fixture(scope="module")
def mongod(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mongod]:
    server = Mongod(tmp_path_factory.mktemp("mongod"))
    server.start()
    yield server
    server.stop()


def record(ring: LogRing, platform: str, count: int, start: int = 0) -> None:
    pose = Channel(platform, "nav/pose", "board", "Pose", f"{platform}:navigator:out")
    battery = Channel(platform, "power/battery", "board", "BatteryState", f"{platform}:hal:out")
    note = Channel(platform, "mission/note", "event", "Text", f"{platform}:mission:out")
    for number in range(start, start + count):
        utc_ns = START + number * SECOND // 10
        ring.append(pose, number, utc_ns, registry.encode(Pose(float(number), 0.0)))
        if number % 10 == 0:
            ring.append(battery, number, utc_ns + 1, registry.encode(BatteryState(12.0, 1.0, 0.5)))
        if number % 50 == 0:
            ring.append(note, number, utc_ns + 2, registry.encode(Text(f"step {number}")))
    ring.flush()


def drain(forwarder: Forwarder) -> None:
    while forwarder.step():
        pass


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    out = []
    for platform in ("uav1", "ugv1"):
        directory = tmp_path_factory.mktemp(platform)
        ring = LogRing(directory, segment_bytes=10_000)
        record(ring, platform, 200)
        ring.close()
        out.append(directory)
    return out


@pytest.fixture(scope="module", params=["folder", "mongod", "mongomock"])
def source(request: pytest.FixtureRequest, folders: list[Path], mongod: Mongod) -> Iterator[Source]:
    if request.param == "folder":
        yield FolderSource(folders)
        return
    if request.param == "mongod":
        store = MongoStore(mongod.uri, "same_answers")
        for directory, platform in zip(folders, ("uav1", "ugv1"), strict=True):
            drain(Forwarder(directory, platform, store, 300))
    else:
        # mongomock cannot do our bulk write; the shape of the query is what it checks
        client: Any = mongomock.MongoClient()
        store = MongoStore("", "same_answers", client=client)
        everything = FolderSource(folders).entries(Query())
        client["same_answers"]["frames"].insert_many([to_document(entry, 1000) for entry in everything])
    yield store
    store.close()


QUERIES = [
    Query(),
    Query(pattern="/uav1/nav/pose"),
    Query(pattern="/*/power/**"),
    Query(pattern="/{ugv}*/**", types=("Text", "BatteryState")),
    Query(since_ns=START + 5 * SECOND, until_ns=START + 6 * SECOND),
    Query(pattern="/uav1/**", limit=7),
    Query(pattern="/uav1/**", limit=7, newest=True),
    Query(pattern="/usv9/**"),
]


@pytest.mark.mongod
@pytest.mark.parametrize("query", QUERIES, ids=repr)
def test_every_source_gives_the_same_answer(source: Source, folders: list[Path], query: Query) -> None:
    def key(entry: Entry) -> tuple[int, str, int]:
        return entry.utc_ns, entry.queue, entry.sequence

    expected = sorted(FolderSource(folders).entries(query), key=key)
    answer = list(source.entries(query))
    assert [entry.utc_ns for entry in answer] == sorted(entry.utc_ns for entry in answer)
    assert sorted(answer, key=key) == expected


@pytest.mark.mongod
def test_a_queue_is_circular_and_keeps_the_newest(mongod: Mongod, tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    record(ring, "uav7", 250)
    ring.close()
    store = MongoStore(mongod.uri, "circular", queue_size=100)
    drain(Forwarder(tmp_path, "uav7", store, 64))
    poses = list(store.entries(Query(pattern="/uav7/nav/pose")))
    store.close()
    assert [entry.sequence for entry in poses] == list(range(151, 251))


@pytest.mark.mongod
def test_the_time_query_uses_the_tree_index(mongod: Mongod) -> None:
    store = MongoStore(mongod.uri, "indexes")
    store.prepare()
    client: MongoClient[dict[str, Any]] = MongoClient(mongod.uri)
    plan = (
        client["indexes"]["frames"]
        .find({"source": "uav1", "type": "Pose", "utc_ns": {"$gte": 1, "$lt": 2}})
        .explain()
    )
    client.close()
    store.close()
    assert "source_type_time" in str(plan["queryPlanner"]["winningPlan"])


@pytest.mark.mongod
def test_a_database_killed_in_the_middle_leaves_no_gap_and_no_duplicate(tmp_path: Path) -> None:
    server = Mongod(tmp_path / "db")
    server.start()
    ring = LogRing(tmp_path / "log", segment_bytes=20_000)
    store = MongoStore(server.uri, "killed", timeout_s=0.5)
    try:
        forwarder = Forwarder(tmp_path / "log", "uav1", store, 50)
        record(ring, "uav1", 400)
        assert forwarder.step() == 50
        forwarder.step()
        server.kill()
        record(ring, "uav1", 300, start=400)
        with pytest.raises(NoAnswer, match="MongoDB"):
            forwarder.step()
        server.start()
        drain(forwarder)
        answer = list(store.entries(Query(pattern="/uav1/nav/pose")))
        assert [entry.sequence for entry in answer] == list(range(1, 701))
        client: MongoClient[dict[str, Any]] = MongoClient(server.uri)
        assert client["killed"]["frames"].count_documents({}) == 700 + 70 + 14
        client.close()
    finally:
        ring.close()
        store.close()
        server.stop()


def test_an_address_that_is_none_is_named() -> None:
    with pytest.raises(ConfigError, match="mongodb_uri 'postgres://x'"):
        MongoStore("postgres://x")
