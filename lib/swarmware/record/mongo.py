"""MongoDB as circular queues of fixed slots: the only file that knows pymongo."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import islice
from typing import Any, Final

import msgspec
from pymongo import ASCENDING, DESCENDING, MongoClient, ReplaceOne
from pymongo.errors import ConfigurationError, InvalidURI, OperationFailure, PyMongoError

from swarmware import names
from swarmware.errors import ConfigError, Denied, NoAnswer
from swarmware.record.cursor import Cursor
from swarmware.record.entry import Entry
from swarmware.record.query import Query

QUEUE_SIZE: Final = 1_000_000
"""Slots of a queue unless the configuration says otherwise: about 300 MB of poses."""

_MS: Final = 1_000_000
_DENIALS: Final = {13, 18}
"""Unauthorized and AuthenticationFailed."""


class MongoStore:
    """Circular queues in one collection; slot `<queue>:<sequence mod size>`, written idempotently.

    Every call may block for the time-out. Raises: NoAnswer when the server is away, Denied
    when it refuses, ConfigError for a URI that is none.
    """

    def __init__(
        self,
        uri: str,
        database: str = "swarm",
        *,
        queue_size: int = QUEUE_SIZE,
        timeout_s: float = 2.0,
        client: Any = None,
    ) -> None:
        self._queue_size = queue_size
        try:
            self._client: Any = client or MongoClient(
                uri,
                serverSelectionTimeoutMS=int(timeout_s * 1000),
                connectTimeoutMS=int(timeout_s * 1000),
                socketTimeoutMS=int(timeout_s * 5000),
                appname="swarmware",
                tz_aware=True,
            )
        except (InvalidURI, ConfigurationError, ValueError) as error:
            raise ConfigError(f"mongodb_uri {uri!r}: {error}; expected mongodb://host:port") from error
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
            self._cursors.replace_one(
                {"_id": platform},
                {"_id": platform, **msgspec.to_builtins(cursor)},
                upsert=True,
            )

    def _slot(self, entry: Entry) -> ReplaceOne[Any]:
        document = to_document(entry, self._queue_size)
        return ReplaceOne({"_id": document["_id"]}, document, upsert=True)

    def cursor(self, platform: str) -> Cursor:
        """How far the platform's ring is stored."""
        with _translated():
            found = self._cursors.find_one({"_id": platform})
        if found is None:
            return Cursor()
        return Cursor(found["segment"], found["offset"], dict(found["sequences"]))

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

    def close(self) -> None:
        """Ends the connections."""
        self._client.close()


def to_document(entry: Entry, queue_size: int) -> dict[str, Any]:
    """The slot that holds this entry."""
    return {
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
        "value": entry.plain(),
        "payload": entry.payload,
    }


def from_document(document: Mapping[str, Any]) -> Entry:
    """The entry in a slot."""
    return Entry(
        document["queue"],
        document["sequence"],
        document["source"],
        document["path"],
        document["kind"],
        document["type"],
        document["stamp_ns"],
        document["utc_ns"],
        bytes(document["payload"]),
    )


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
            raise Denied(f"MongoDB: {error}") from error
        raise NoAnswer(f"MongoDB: {error}") from error
    except PyMongoError as error:
        raise NoAnswer(f"MongoDB: {error}") from error
