"""The local ring and MongoDB give the same answers; a database that goes away costs nothing."""

import re
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mongomock
import msgspec
import pytest
from pymongo import MongoClient
from pymongo.errors import BulkWriteError
from tests.integration.recorder.mongod import Mongod
from tests.patience import PATIENCE_S

from swarmd.logger.log_forwarder import LogForwarder
from swarmware.errors import ConfigError, NoAnswer, SwarmError
from swarmware.recorder.entry import Cursor, LogEntry
from swarmware.recorder.mongo import MongoStore, RefusedEntry, check_uri, digest, to_document
from swarmware.recorder.payload_type import logged_description
from swarmware.recorder.query import FolderSource, LogSource, Query, stats
from swarmware.recorder.ring import LogRing
from swarmware.recorder.segment import LogChannel
from swarmware.types import registry
from swarmware.types.description import describe
from swarmware.types.scalar import Text
from swarmware.types.vehicle import BatteryState, Pose

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


class Salinity(msgspec.Struct, frozen=True, array_like=True):
    """A type of a module, which is not registered here."""

    psu: float


SALINITY = logged_description(msgspec.json.encode(describe(Salinity)).decode())


@pytest.fixture(scope="module")
def mongod(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mongod]:
    server = Mongod(tmp_path_factory.mktemp("mongod"))
    server.start()
    yield server
    server.stop()


def record(ring: LogRing, platform: str, count: int, start: int = 0) -> None:
    pose = LogChannel(platform, "nav/pose", "board", "Pose", f"{platform}:navigator:out")
    battery = LogChannel(platform, "power/battery", "board", "BatteryState", f"{platform}:hal:out")
    note = LogChannel(platform, "mission/note", "event", "Text", f"{platform}:mission:out")
    salt = LogChannel(platform, "sea/salt", "board", "Salinity", f"{platform}:probe:out", "", SALINITY)
    for number in range(start, start + count):
        utc_ns = START + number * SECOND // 10
        ring.append(pose, number, utc_ns, registry.encode(Pose(float(number), 0.0)))
        if number % 10 == 0:
            ring.append(battery, number, utc_ns + 1, registry.encode(BatteryState(12.0, 1.0, 0.5)))
        if number % 50 == 0:
            ring.append(note, number, utc_ns + 2, registry.encode(Text(f"step {number}")))
            ring.append(salt, number, utc_ns + 3, registry.encode(Salinity(float(number))))
    ring.flush()


def drain(forwarder: LogForwarder) -> None:
    while forwarder.step():
        pass


def drain_once_it_answers(forwarder: LogForwarder) -> None:
    """As the logger does: the driver looks for a server that was away twice a second, as long as it waits."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return drain(forwarder)
        except NoAnswer:
            assert time.monotonic() < end_s


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
def source(request: pytest.FixtureRequest, folders: list[Path], mongod: Mongod) -> Iterator[LogSource]:
    if request.param == "folder":
        yield FolderSource(folders)
        return
    if request.param == "mongod":
        store = MongoStore(mongod.uri, "same_answers")
        for directory, platform in zip(folders, ("uav1", "ugv1"), strict=True):
            drain(LogForwarder(directory, platform, store, 300))
    else:
        # mongomock cannot do our bulk write; the shape of the query is what it checks
        client: Any = mongomock.MongoClient()
        store = MongoStore("", "same_answers", client=client)
        everything = FolderSource(folders).entries(Query())
        client["same_answers"]["types"].insert_one({"_id": digest(SALINITY), "description": SALINITY})
        client["same_answers"]["frames"].insert_many([dict(to_document(entry, 1000)) for entry in everything])
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
def test_every_source_gives_the_same_answer(source: LogSource, folders: list[Path], query: Query) -> None:
    def key(entry: LogEntry) -> tuple[int, str, int]:
        return entry.utc_ns, entry.queue, entry.sequence

    expected = sorted(FolderSource(folders).entries(query), key=key)
    answer = list(source.entries(query))
    assert [entry.utc_ns for entry in answer] == sorted(entry.utc_ns for entry in answer)
    assert sorted(answer, key=key) == expected
    salt = [entry.plain() for entry in answer if entry.type == "Salinity"]
    assert all(list(value) == ["psu"] for value in salt)


@pytest.mark.mongod
def test_a_queue_is_circular_and_keeps_the_newest(mongod: Mongod, tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    record(ring, "uav7", 250)
    ring.close()
    store = MongoStore(mongod.uri, "circular", queue_size=100)
    drain(LogForwarder(tmp_path, "uav7", store, 64))
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
def test_killed_database_leaves_no_gap_or_duplicate(tmp_path: Path) -> None:
    server = Mongod(tmp_path / "db")
    server.start()
    ring = LogRing(tmp_path / "log", segment_bytes=20_000)
    store = MongoStore(server.uri, "killed", timeout_s=0.5)
    try:
        forwarder = LogForwarder(tmp_path / "log", "uav1", store, 50)
        record(ring, "uav1", 400)
        assert forwarder.step() == 50
        forwarder.step()
        server.kill()
        record(ring, "uav1", 300, start=400)
        with pytest.raises(NoAnswer, match="MongoDB"):
            forwarder.step()
        server.start()
        drain_once_it_answers(forwarder)
        answer = list(store.entries(Query(pattern="/uav1/nav/pose")))
        assert [entry.sequence for entry in answer] == list(range(1, 701))
        client: MongoClient[dict[str, Any]] = MongoClient(server.uri)
        assert client["killed"]["frames"].count_documents({}) == 700 + 70 + 14 + 14
        client.close()
    finally:
        ring.close()
        store.close()
        server.stop()


@pytest.mark.mongod
def test_answers_hold_plain_numbers_that_json_takes(mongod: Mongod, tmp_path: Path) -> None:
    ring = LogRing(tmp_path)
    record(ring, "uav5", 20)
    ring.close()
    store = MongoStore(mongod.uri, "plain")
    drain(LogForwarder(tmp_path, "uav5", store, 64))
    entries = list(store.entries(Query()))
    store.close()
    assert len(entries) == 20 + 2 + 1 + 1
    for entry in entries:
        assert {type(value) for value in (entry.sequence, entry.stamp_ns, entry.utc_ns)} == {int}
    assert msgspec.json.decode(msgspec.json.encode(entries[0])) != {}
    assert msgspec.json.decode(msgspec.json.encode(stats(entries)))[0]["entries"] == 2


@pytest.mark.mongod
def test_byte_bounded_queue_loses_its_oldest_entries(mongod: Mongod, tmp_path: Path) -> None:
    bound = 200_000
    ring = LogRing(tmp_path)
    channel = LogChannel("uav6", "a/text", "event", "Text", "uav6:a:out")
    for number in range(600):
        ring.append(channel, number, START + number, registry.encode(Text("x" * (500 + number % 7 * 300))))
    ring.close()
    store = MongoStore(mongod.uri, "bytes", queue_bytes=bound)
    drain(LogForwarder(tmp_path, "uav6", store, 50))
    again = MongoStore(mongod.uri, "bytes", queue_bytes=bound)  # as after a restart
    again.write(list(FolderSource([tmp_path]).entries(Query()))[-10:], "uav6", Cursor())
    sequences = [entry.sequence for entry in again.entries(Query())]
    store.close()
    again.close()
    client: MongoClient[dict[str, Any]] = MongoClient(mongod.uri)
    sizes = {"$group": {"_id": "$queue", "bytes": {"$sum": {"$bsonSize": "$$ROOT"}}}}
    (measured,) = client["bytes"]["frames"].aggregate([sizes])
    client.close()
    assert bound / 2 < measured["bytes"] <= bound
    assert sequences == list(range(sequences[0], 601))


@pytest.mark.mongod
def test_values_outside_bson_are_stored_as_payload(mongod: Mongod) -> None:
    store = MongoStore(mongod.uri, "awkward")
    payloads = [
        registry.encode(Text("a\x00b")),
        msgspec.msgpack.encode({"a\x00b": 1}),
        msgspec.msgpack.encode({1: 2}),
        msgspec.msgpack.encode([1 << 63]),
        msgspec.msgpack.encode(msgspec.msgpack.Ext(5, b"abc")),
        msgspec.msgpack.encode([0] * 3_000_000),
    ]
    entries = [
        LogEntry("uav1:x:out", number, "uav1", "x", "event", "Unknown", 1, START + number, payload)
        for number, payload in enumerate(payloads, start=1)
    ]
    store.write(entries, "uav1", Cursor())
    assert [entry.payload for entry in store.entries(Query())] == payloads
    store.close()


def nested(levels: int) -> bytes:
    """MessagePack of maps within maps."""
    return b"\x81\xa1a" * levels + b"\x07"


@pytest.mark.mongod
@pytest.mark.parametrize("levels", [150, 179, 180, 199, 200, 300, 900, 2000])
def test_value_nested_too_deep_is_set_aside(mongod: Mongod, tmp_path: Path, levels: int) -> None:
    ring = LogRing(tmp_path)
    channel = LogChannel("uav1", "a/value", "event", "Unknown", "uav1:a:out")
    for number in range(1, 21):
        payload = nested(levels) if number in (2, 13) else nested(1)
        ring.append(channel, number, START + number, payload)
    ring.close()
    store = MongoStore(mongod.uri, f"nested{levels}")
    drain(LogForwarder(tmp_path, "uav1", store, 64))
    refused = [one.entry.sequence for one in store.refused]
    found = list(store.entries(Query()))
    documents = {one["sequence"]: one for one in store._frames.find()}
    store.close()
    assert [entry.sequence for entry in found] == list(range(1, 21))
    assert [entry.payload == nested(levels) for entry in found] == [n in (2, 13) for n in range(1, 21)]
    assert documents[1]["value"] == {"a": 7} and "reason" not in documents[1]
    if levels < 180:
        assert documents[13]["value"] is not None and "reason" not in documents[13]
    else:
        assert documents[13]["value"] is None
    if 180 <= levels <= 300:
        assert refused == [2, 13] and "nest" in documents[13]["reason"]


@pytest.mark.mongod
def test_entry_refused_by_validator_keeps_payload_or_reason(mongod: Mongod) -> None:
    client: MongoClient[dict[str, Any]] = MongoClient(mongod.uri)
    collection = client["validated"].create_collection("frames", validator={"value.value": {"$ne": 7}})
    store = MongoStore(mongod.uri, "validated")
    entries = [
        LogEntry(
            "uav1:x:out", number, "uav1", "x", "event", "Int", 1, START + number, b"\x91" + bytes([value])
        )
        for number, value in enumerate((6, 7, 8), start=1)
    ]
    try:
        store.write(entries, "uav1", Cursor())
        assert [(one.entry.sequence, one.reason) for one in store.refused] == [
            (2, "Document failed validation")
        ]
        assert [one["value"] for one in collection.find().sort("sequence")] == [
            {"value": 6},
            None,
            {"value": 8},
        ]
        collection.delete_many({})
        client["validated"].command("collMod", "frames", validator={"payload": {"$ne": b"\x91\x07"}})
        store.write(entries, "uav1", Cursor())
        assert [one["payload"] for one in collection.find().sort("sequence")] == [
            b"\x91\x06",
            b"",
            b"\x91\x08",
        ]
        collection.delete_many({})
        client["validated"].command("collMod", "frames", validator={"sequence": {"$lt": 0}})
        with pytest.raises(SwarmError, match="MongoDB refuses entries: Document failed") as caught:
            store.write(entries, "uav1", Cursor())
        assert not isinstance(caught.value, NoAnswer), "a server that refuses is not unreachable"
    finally:
        store.close()
        client.close()


@pytest.mark.mongod
@pytest.mark.parametrize("until", [1, 2])
def test_server_that_refuses_for_moment_costs_no_value(
    mongod: Mongod, monkeypatch: pytest.MonkeyPatch, until: int
) -> None:
    store = MongoStore(mongod.uri, f"moment{until}")
    entry = LogEntry("uav1:x:out", 1, "uav1", "x", "event", "Int", 1, START, b"\x91\x07")
    replace, calls = store._replace, 0

    def refusing(slots: Any) -> list[RefusedEntry]:
        nonlocal calls
        calls += 1
        return [RefusedEntry(one, "busy") for one, _ in slots] if calls <= until else replace(slots)

    monkeypatch.setattr(store, "_replace", refusing)
    store.write([entry], "uav1", Cursor())
    (found,) = store._frames.find()
    store.close()
    assert (found["value"], found["payload"], store.refused) == ({"value": 7}, b"\x91\x07", [])


@pytest.mark.mongod
def test_full_server_keeps_entries_in_ring(mongod: Mongod, monkeypatch: pytest.MonkeyPatch) -> None:
    store = MongoStore(mongod.uri, "full")
    entry = LogEntry("uav1:x:out", 1, "uav1", "x", "event", "Int", 1, START, b"\x91\x07")

    def bulk_write(*_: Any, **__: Any) -> None:
        raise BulkWriteError({"writeErrors": [{"index": 0, "code": 14031, "errmsg": "no space"}]})

    frames: Any = SimpleNamespace(bulk_write=bulk_write, aggregate=store._frames.aggregate)
    monkeypatch.setattr(store, "_frames", frames)
    with pytest.raises(SwarmError, match="MongoDB has no room: no space"):
        store.write([entry], "uav1", Cursor())
    assert store.cursor("uav1") == Cursor() and store._cursors.find_one({"_id": "uav1"}) is None
    store.close()


@pytest.mark.mongod
def test_stamp_beyond_64_bits_is_stored_as_nearest(mongod: Mongod) -> None:
    store = MongoStore(mongod.uri, "stamps")
    entries = [
        LogEntry("uav1:x:out", number, "uav1", "x", "event", "Int", stamp, START, b"\x91\x07")
        for number, stamp in enumerate((-(1 << 70), 1 << 63), start=1)
    ]
    store.write(entries, "uav1", Cursor())
    found = sorted(entry.stamp_ns for entry in store.entries(Query()))
    store.close()
    assert found == [1 - (1 << 63), (1 << 63) - 1]


@pytest.mark.mongod
def test_an_empty_answer_names_the_databases_there_are(mongod: Mongod) -> None:
    there = MongoStore(mongod.uri, "swarm_lab1")
    there.prepare()
    store = MongoStore(mongod.uri, "swarm")
    assert re.fullmatch(r"no database 'swarm' on this server; existing: .*swarm_lab1.*", store.why_empty())
    store.close()
    assert there.why_empty() == ""
    there.close()


def test_unreachable_server_is_one_short_line() -> None:
    store = MongoStore("mongodb://127.0.0.1:1", timeout_s=0.2)
    with pytest.raises(NoAnswer) as caught:
        store.ping()
    store.close()
    assert str(caught.value).startswith("MongoDB: 127.0.0.1:1: [Errno 111] Connection refused")
    assert len(str(caught.value)) < 120
    assert "opology" not in str(caught.value)


@pytest.mark.parametrize(
    "uri",
    [
        "mongodb://swarm:s3cret@host:x",
        "mongodb://swarm:s3cret@",
        "mongo//swarm:s3cret@host",
        "mongodb://swarm:s3cret@host/?connectTimeoutMS=never&unknown=s3cret",
        "mongodb://swarm:s3cret:@host:99999",
    ],
)
def test_invalid_address_is_error_without_its_password(uri: str) -> None:
    for make in (check_uri, MongoStore):
        with pytest.raises(ConfigError, match="expected mongodb://host:port") as caught:
            make(uri)
        assert "s3cret" not in str(caught.value)


def test_an_address_that_is_none_is_named() -> None:
    with pytest.raises(ConfigError, match="mongodb_uri 'postgres://x'"):
        MongoStore("postgres://x")
