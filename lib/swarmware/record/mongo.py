"""MongoDB as circular queues of fixed slots: the only file that knows pymongo.

Raises: ConfigError when it is imported and pymongo is not installed.
"""

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import islice
from typing import Any, Final

import msgspec

from swarmware import names
from swarmware.errors import ConfigError, Denied, NoAnswer, missing_extra
from swarmware.record.address import password_in, without_password
from swarmware.record.cursor import Cursor
from swarmware.record.entry import Entry
from swarmware.record.query import Query

try:
    from bson import encode
    from bson.errors import BSONError
    from bson.raw_bson import RawBSONDocument
    from pymongo import ASCENDING, DESCENDING, MongoClient, ReplaceOne
    from pymongo.errors import OperationFailure, PyMongoError
except ImportError as error:
    raise missing_extra("mongodb", error, "mongo") from error

QUEUE_SIZE: Final = 1_000_000
"""Slots of a queue unless the configuration says otherwise: about 300 MB of poses."""

QUEUE_BYTES: Final = 64 << 20
"""Bytes of BSON in a queue: eight queues of a vehicle are as large as its local ring."""
_TRIMMED: Final = 0.9
"""A queue that grew too large is cut to this share of its bound, so that it is measured seldom."""
_OWN: Final = frozenset({"admin", "config", "local"})
"""Databases of the server itself."""
_MS: Final = 1_000_000
_DOCUMENT_LIMIT: Final = 16_000_000
"""Of a document the server takes 16 MiB."""
_LINE: Final = 160
_TIMEOUTS: Final = re.compile(r" \(configured timeouts:[^)]*\)")
_DENIALS: Final = {13, 18}
"""Unauthorized and AuthenticationFailed."""


class MongoStore:
    """Circular queues in one collection; slot `<queue>:<sequence mod size>`, written idempotently.

    A call may block for `timeout_s` to find the server, and for `answer_s` each time that it is asked.
    Raises: NoAnswer when the server is away, Denied when it refuses, ConfigError for a URI that is none.
    """

    def __init__(
        self,
        uri: str,
        database: str = "swarm",
        *,
        queue_size: int = QUEUE_SIZE,
        queue_bytes: int = QUEUE_BYTES,
        timeout_s: float = 2.0,
        answer_s: float = 10.0,
        client: Any = None,
    ) -> None:
        self._queue_size = queue_size
        self._queue_bytes = queue_bytes
        self._bytes: dict[str, int] = {}
        """Bytes of each queue written here, at most."""
        self._client: Any = client or _client(
            uri,
            serverSelectionTimeoutMS=int(timeout_s * 1000),
            connectTimeoutMS=int(timeout_s * 1000),
            socketTimeoutMS=int(answer_s * 1000),
            appname="swarmware",
            tz_aware=True,
        )
        self._database = database
        self._frames = self._client[database]["frames"]
        self._cursors = self._client[database]["cursors"]

    def prepare(self) -> None:
        """Makes the B-tree indexes of S0.71; cheap when they are there."""
        with _translated():
            self._frames.create_index(
                [("source", ASCENDING), ("type", ASCENDING), ("utc_ns", ASCENDING)], name="source_type_time"
            )
            self._frames.create_index(
                [("source", ASCENDING), ("path", ASCENDING), ("utc_ns", ASCENDING)], name="source_path_time"
            )
            self._frames.create_index([("queue", ASCENDING), ("sequence", ASCENDING)], name="queue_sequence")
            self._frames.create_index([("utc_ns", ASCENDING)], name="time")

    def write(self, entries: Sequence[Entry], platform: str, cursor: Cursor) -> None:
        """Stores the entries, then remembers how far the platform's ring is stored.

        A crash in between stores the same entries again into the same slots.
        """
        with _translated():
            if entries:
                self._frames.bulk_write([self._slot(entry) for entry in entries], ordered=False)
                for queue in sorted({entry.queue for entry in entries}):
                    if self._bytes[queue] > self._queue_bytes:
                        self._trim(queue)
            self._cursors.replace_one(
                {"_id": platform},
                {"_id": platform, **msgspec.to_builtins(cursor)},
                upsert=True,
            )

    def _slot(self, entry: Entry) -> ReplaceOne[Any]:
        document = to_document(entry, self._queue_size)
        if entry.queue not in self._bytes:
            self._bytes[entry.queue] = self._measured(entry.queue)
        self._bytes[entry.queue] += len(document.raw)
        return ReplaceOne({"_id": document["_id"]}, document, upsert=True)

    def _measured(self, queue: str) -> int:
        """Bytes of the documents in a queue."""
        total = {"$group": {"_id": None, "bytes": {"$sum": {"$bsonSize": "$$ROOT"}}}}
        found = list(self._frames.aggregate([{"$match": {"queue": queue}}, total]))
        return int(found[0]["bytes"]) if found else 0

    def _trim(self, queue: str) -> None:
        """Removes the oldest entries of a queue that has grown beyond its bytes."""
        measured = self._measured(queue)
        if measured > self._queue_bytes:
            excess = measured - int(self._queue_bytes * _TRIMMED)
            sizes = self._frames.find({"queue": queue}, {"sequence": 1, "size": {"$bsonSize": "$$ROOT"}})
            last = -1
            for document in sizes.sort("sequence", ASCENDING):
                if excess <= 0:
                    break
                last = int(document["sequence"])
                excess -= int(document["size"])
                measured -= int(document["size"])
            self._frames.delete_many({"queue": queue, "sequence": {"$lte": last}})
        self._bytes[queue] = measured

    def cursor(self, platform: str) -> Cursor:
        """How far the platform's ring is stored."""
        with _translated():
            found = self._cursors.find_one({"_id": platform})
        if found is None:
            return Cursor()
        sequences = {queue: int(number) for queue, number in found["sequences"].items()}
        return Cursor(int(found["segment"]), int(found["offset"]), sequences)

    def entries(self, query: Query) -> Iterator[Entry]:
        """Entries that answer the query, by UTC."""
        with _translated():
            yield from self._find(query)

    def _find(self, query: Query) -> Iterator[Entry]:
        pattern = names.Pattern(query.pattern)
        found: Iterable[Mapping[str, Any]] = self._frames.find(to_filter(query)).sort(
            "utc_ns", DESCENDING if query.newest else ASCENDING
        )
        matching = (entry for entry in map(from_document, found) if pattern.matches(entry.topic))
        taken = islice(matching, query.limit)
        yield from reversed(list(taken)) if query.newest else taken

    def losses(self) -> list[str]:
        """None: an answer is whole, or an error."""
        return []

    def nothing(self) -> str:
        """Says when the database does not exist, and which do."""
        with _translated():
            there = sorted(set(self._client.list_database_names()) - _OWN)
        if self._database in there:
            return ""
        return f"no database {self._database!r} there; there are: {', '.join(there) or 'none'}"

    def ping(self) -> None:
        """Whether the server answers.

        Raises: NoAnswer, Denied.
        """
        with _translated():
            self._client.admin.command("ping")

    def close(self) -> None:
        """Ends the connections."""
        self._client.close()


def to_document(entry: Entry, queue_size: int) -> RawBSONDocument:
    """The slot that holds this entry; a value that BSON cannot hold stays in the payload alone."""
    document = {
        "_id": f"{entry.queue}:{entry.sequence % queue_size}",
        "queue": entry.queue,
        "sequence": entry.sequence,
        "source": entry.platform,
        "path": entry.path,
        "kind": entry.kind,
        "type": entry.type,
        "stamp_ns": entry.stamp_ns,
        "utc_ns": entry.utc_ns,
        "utc": datetime.fromtimestamp(entry.utc_ns // _MS / 1000, UTC),
        **({"sender": entry.sender} if entry.sender else {}),
        "value": entry.plain(),
        "payload": entry.payload,
    }
    try:
        data = encode(document)
    except (BSONError, OverflowError, RecursionError, TypeError, ValueError):
        data = b""
    if not data or len(data) > _DOCUMENT_LIMIT:
        data = encode(document | {"value": None})
    return RawBSONDocument(data)


def from_document(document: Mapping[str, Any]) -> Entry:
    """The entry in a slot; numbers as plain ones, BSON has a type of its own for them."""
    return Entry(
        str(document["queue"]),
        int(document["sequence"]),
        str(document["source"]),
        str(document["path"]),
        str(document["kind"]),
        str(document["type"]),
        int(document["stamp_ns"]),
        int(document["utc_ns"]),
        bytes(document["payload"]),
        str(document.get("sender", "")),
    )


def check_uri(uri: str) -> None:
    """Whether a client would take the address; it is not contacted.

    Raises: ConfigError, without the password in it.
    """
    _client(uri, connect=False).close()


def _client(uri: str, **options: Any) -> MongoClient[Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # an option that it does not take is only warned of
            return MongoClient(uri, **options)
    except (PyMongoError, ValueError, TypeError, UserWarning) as error:
        raise ConfigError(_wrong_uri(uri, error)) from None


def _wrong_uri(uri: str, error: Exception) -> str:
    secret = password_in(uri)
    shown = without_password(uri).partition("?")[0]  # options may be secrets, too
    text = f"mongodb_uri {shown!r}: {error}"
    return f"{text.replace(secret, '***') if secret else text}; expected mongodb://host:port"


def to_filter(query: Query) -> dict[str, Any]:
    """The part of a query that the database answers by its indexes; the pattern is checked again here."""
    out: dict[str, Any] = {}
    pattern = names.Pattern(query.pattern)
    platform, local = names.split(query.pattern)
    if platform and not any(char in platform for char in "*{"):
        out["source"] = platform
    if pattern.literal and local:
        out["path"] = local
    if query.types:
        out["type"] = {"$in": list(query.types)}
    window = {"$gte": query.since_ns, "$lt": query.until_ns}
    window = {operator: bound for operator, bound in window.items() if bound is not None}
    if window:
        out["utc_ns"] = window
    return out


@contextmanager
def _translated() -> Iterator[None]:
    """Turns the driver's errors into ours."""
    try:
        yield
    except OperationFailure as error:
        if error.code in _DENIALS:
            raise Denied(f"MongoDB: {_short(error)}") from error
        raise NoAnswer(f"MongoDB: {_short(error)}") from error
    except PyMongoError as error:
        raise NoAnswer(f"MongoDB: {_short(error)}") from error


def _short(error: Exception) -> str:
    """One line: the driver adds its time-outs and the topology of all servers."""
    text = _TIMEOUTS.sub("", str(error).split(", Timeout:")[0].split(", full error:")[0])
    return text if len(text) <= _LINE else text[: _LINE - 1] + "…"
