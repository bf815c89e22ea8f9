"""MongoDB as circular queues of fixed slots: the only file that imports pymongo.

Raises: ConfigError when it is imported and pymongo is not installed.
"""

import hashlib
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import islice
from typing import Any, Final, NamedTuple

import msgspec

from swarmware.errors import ConfigError, Denied, NoAnswer, SwarmError, missing_extra
from swarmware.model import names
from swarmware.recorder.address import password_in, without_password
from swarmware.recorder.entry import Cursor, LogEntry
from swarmware.recorder.query import Query

try:
    from bson import encode
    from bson.errors import BSONError, InvalidDocument
    from bson.raw_bson import RawBSONDocument
    from pymongo import ASCENDING, DESCENDING, MongoClient, ReplaceOne
    from pymongo.errors import BulkWriteError, OperationFailure, PyMongoError
except ImportError as error:
    raise missing_extra("mongodb", error, "mongo") from error

QUEUE_SIZE: Final = 1_000_000
"""Default number of slots of a queue: about 300 MB of poses."""

QUEUE_BYTES: Final = 64 << 20
"""Default size of a queue in BSON: the eight queues of a vehicle are as large as its local ring."""
_TRIMMED: Final = 0.9
"""A queue over its limit is trimmed to this share of it, so that its size is rarely measured."""
_OWN: Final = frozenset({"admin", "config", "local"})
"""Internal databases of the server."""
_MS: Final = 1_000_000
_DOCUMENT_LIMIT: Final = 16_000_000
"""The server limits a document to 16 MiB."""
_LINE: Final = 160
_TIMEOUTS: Final = re.compile(r" \(configured timeouts:[^)]*\)")
_DENIALS: Final = {13, 18}
"""Unauthorized and AuthenticationFailed."""
_MALFORMED: Final = {2, 9, 14, 15, 22, 10334}
"""BadValue, FailedToParse, TypeMismatch, Overflow, InvalidBSON, BSONObjectTooLarge: with these the server
refuses a whole request because of one document, such as a document with 200 levels."""
_NO_ROOM: Final = {14031, 8000}
"""OutOfDiskSpace, and the quota of MongoDB Atlas: smaller documents would fit, at the cost of values."""
_INT64: Final = (1 << 63) - 1


class RefusedEntry(NamedTuple):
    """An entry whose document the server refuses."""

    entry: LogEntry
    reason: str


class MongoStore:
    """Circular queues in one collection; slot `<queue>:<sequence mod size>`, written idempotently.

    A call may block for `timeout_s` to select the server, and for `answer_s` for each request.
    Raises: NoAnswer when the server is unreachable, Denied without the rights, SwarmError when it refuses a
    request for another reason, ConfigError for an invalid URI.
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
        """Upper bound of the size of each queue written here."""
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
        self._types = self._client[database]["types"]
        self._stored_types: set[str] = set()
        """Descriptions that were written here."""
        self.refused: list[RefusedEntry] = []
        """Entries of the last `write` whose documents the server refused: they are stored without value."""

    def prepare(self) -> None:
        """Creates the B-tree indexes of S0.71; cheap when they exist."""
        # the server may be another one, or empty, after a lost connection
        self._stored_types.clear()
        with _translated():
            self._frames.create_index(
                [("source", ASCENDING), ("type", ASCENDING), ("utc_ns", ASCENDING)], name="source_type_time"
            )
            self._frames.create_index(
                [("source", ASCENDING), ("path", ASCENDING), ("utc_ns", ASCENDING)], name="source_path_time"
            )
            self._frames.create_index([("queue", ASCENDING), ("sequence", ASCENDING)], name="queue_sequence")
            self._frames.create_index([("utc_ns", ASCENDING)], name="time")

    def write(self, entries: Sequence[LogEntry], platform: str, cursor: Cursor) -> None:
        """Stores the entries, then the cursor.

        After a crash in between the same entries are written to the same slots once more. An entry whose
        document the server refuses is set aside: stored with its payload and the reason, without its value.
        """
        self.refused = []
        with _translated():
            if entries:
                self._write_types({entry.description for entry in entries} - self._stored_types - {""})
                self._write_entries(entries)
                for queue in sorted({entry.queue for entry in entries}):
                    if self._bytes[queue] > self._queue_bytes:
                        self._trim(queue)
            # last: an entry behind the cursor is never sent again
            self._cursors.replace_one(
                {"_id": platform},
                {"_id": platform, **msgspec.to_builtins(cursor)},
                upsert=True,
            )

    def _write_types(self, descriptions: set[str]) -> None:
        """Stores descriptions of types once, before the first entry that names them."""
        for text in descriptions:
            self._types.replace_one(
                {"_id": digest(text)}, {"_id": digest(text), "description": text}, upsert=True
            )
        self._stored_types |= descriptions

    def _write_entries(self, entries: Sequence[LogEntry]) -> None:
        """Stores the document of each entry; of a refused one what the server takes.

        Raises: SwarmError when the server refuses even the names and stamps of an entry: then the server is
        at fault, not the document.
        """
        refused = self._replace([(entry, to_document(entry, self._queue_size)) for entry in entries])
        # less and less of an entry is tried, so that a name and a stamp remain of each
        without_value = self._replace(self._bare(refused))
        if left := self._replace(self._bare(without_value, with_payload=False)):
            raise SwarmError(f"MongoDB refuses entries: {left[0].reason}")
        # again: a server that refused for a short time must not cost the values of that time
        whole = [(one.entry, to_document(one.entry, self._queue_size)) for one in refused]
        self.refused = self._replace(whole)
        large = {(one.entry.queue, one.entry.sequence) for one in without_value}
        self._replace(
            self._bare([one for one in self.refused if (one.entry.queue, one.entry.sequence) in large])
        )

    def _bare(
        self, refused: Sequence[RefusedEntry], *, with_payload: bool = True
    ) -> list[tuple[LogEntry, RawBSONDocument]]:
        return [
            (one.entry, bare_document(one.entry, self._queue_size, one.reason, with_payload))
            for one in refused
        ]

    def _replace(self, slots: Sequence[tuple[LogEntry, RawBSONDocument]]) -> list[RefusedEntry]:
        """Writes each document to its slot; the refused ones.

        A request that is refused as a whole is halved until the document at fault is alone.
        """
        if not slots:
            return []
        try:
            # unordered: a refused document does not stop the ones behind it
            self._frames.bulk_write([self._slot(*slot) for slot in slots], ordered=False)
        except BulkWriteError as error:
            refused = error.details.get("writeErrors")
            if not refused:
                raise  # of the write concern: the documents are stored, but not as safely as asked
            # not the documents are at fault: the batch is repeated when there is room
            if any(one["code"] in _NO_ROOM for one in refused):
                raise SwarmError(f"MongoDB has no room: {_short(str(refused[0]['errmsg']))}") from error
            return [RefusedEntry(slots[one["index"]][0], _short(str(one["errmsg"]))) for one in refused]
        except (OperationFailure, InvalidDocument) as error:
            # a fault of the server or of the rights, which smaller requests would have as well
            if isinstance(error, OperationFailure) and error.code not in _MALFORMED:
                raise
            if len(slots) == 1:
                return [RefusedEntry(slots[0][0], _short(str(error)))]
            middle = len(slots) // 2
            return self._replace(slots[:middle]) + self._replace(slots[middle:])
        return []

    def _slot(self, entry: LogEntry, document: RawBSONDocument) -> ReplaceOne[Any]:
        # measured once by the server; then an upper bound is counted here
        if entry.queue not in self._bytes:
            self._bytes[entry.queue] = self._measured(entry.queue)
        self._bytes[entry.queue] += len(document.raw)
        return ReplaceOne({"_id": document["_id"]}, document, upsert=True)

    def _measured(self, queue: str) -> int:
        """Size of the documents of a queue, in bytes."""
        total = {"$group": {"_id": None, "bytes": {"$sum": {"$bsonSize": "$$ROOT"}}}}
        found = list(self._frames.aggregate([{"$match": {"queue": queue}}, total]))
        return int(found[0]["bytes"]) if found else 0

    def _trim(self, queue: str) -> None:
        """Removes the oldest entries of a queue that exceeds its size limit."""
        measured = self._measured(queue)
        if measured > self._queue_bytes:
            # below the limit, so that not every batch has to trim
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
        """Position in the platform's ring up to which entries are stored."""
        with _translated():
            found = self._cursors.find_one({"_id": platform})
        if found is None:
            return Cursor()
        sequences = {queue: int(number) for queue, number in found["sequences"].items()}
        return Cursor(int(found["segment"]), int(found["offset"]), sequences)

    def entries(self, query: Query) -> Iterator[LogEntry]:
        """Entries that match the query, sorted by UTC."""
        with _translated():
            yield from self._find(query)

    def _find(self, query: Query) -> Iterator[LogEntry]:
        pattern = names.Pattern(query.pattern)
        found: Iterable[Mapping[str, Any]] = self._frames.find(to_filter(query)).sort(
            "utc_ns", DESCENDING if query.newest else ASCENDING
        )
        described = {one["_id"]: str(one["description"]) for one in self._types.find()}
        made = (from_document(one, described) for one in found)
        # again here: the filter of the server is wider than the pattern
        matching = (entry for entry in made if pattern.matches(entry.topic))
        taken = islice(matching, query.limit)
        yield from reversed(list(taken)) if query.newest else taken

    def losses(self) -> list[str]:
        """Always empty: a query succeeds completely or raises."""
        return []

    def why_empty(self) -> str:
        """Reports a database that does not exist, with the names of those that do."""
        with _translated():
            there = sorted(set(self._client.list_database_names()) - _OWN)
        if self._database in there:
            return ""
        return f"no database {self._database!r} on this server; existing: {', '.join(there) or 'none'}"

    def ping(self) -> None:
        """Checks that the server answers.

        Raises: NoAnswer, Denied.
        """
        with _translated():
            self._client.admin.command("ping")

    def close(self) -> None:
        """Closes the connections to the server."""
        self._client.close()


def to_document(entry: LogEntry, queue_size: int) -> RawBSONDocument:
    """The document of an entry; a value that BSON cannot represent is set aside, with the reason."""
    document = _names_and_stamps(entry, queue_size) | {"value": entry.plain(), "payload": entry.payload}
    try:
        data = encode(document)
    except (BSONError, OverflowError, RecursionError, TypeError, ValueError) as error:
        return bare_document(entry, queue_size, _short(f"BSON cannot represent it: {error}"))
    if len(data) > _DOCUMENT_LIMIT:
        reason = f"{len(data)} bytes; expected at most {_DOCUMENT_LIMIT}"
        return bare_document(entry, queue_size, reason)
    return RawBSONDocument(data)


def bare_document(
    entry: LogEntry, queue_size: int, reason: str, with_payload: bool = True
) -> RawBSONDocument:
    """The document of an entry that is set aside: without its value, and with the reason for that."""
    left = {"value": None, "reason": reason, "payload": entry.payload if with_payload else b""}
    return RawBSONDocument(encode(_names_and_stamps(entry, queue_size) | left))


def _names_and_stamps(entry: LogEntry, queue_size: int) -> dict[str, Any]:
    return {
        "_id": f"{entry.queue}:{entry.sequence % queue_size}",
        "queue": entry.queue,
        "sequence": entry.sequence,
        "source": entry.platform,
        "path": entry.path,
        "kind": entry.kind,
        "type": entry.type,
        # a stamp of another platform may be any number; BSON has 64 bits
        "stamp_ns": max(-_INT64, min(entry.stamp_ns, _INT64)),
        "utc_ns": entry.utc_ns,
        "utc": datetime.fromtimestamp(entry.utc_ns // _MS / 1000, UTC),
        **({"sender": entry.sender} if entry.sender else {}),
        **({"sent_utc_ns": entry.sent_utc_ns} if entry.sent_utc_ns else {}),
        **({"description": digest(entry.description)} if entry.description else {}),
    }


def digest(description: str) -> str:
    """Id of the description of a type in its collection."""
    return hashlib.sha256(description.encode()).hexdigest()


def from_document(document: Mapping[str, Any], descriptions: Mapping[str, str]) -> LogEntry:
    """The entry in a document; BSON integers become int. `descriptions`: by their id."""
    return LogEntry(
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
        int(document.get("sent_utc_ns", 0)),
        descriptions.get(document.get("description", ""), ""),
    )


def check_uri(uri: str) -> None:
    """Validates the address without contacting the server.

    Raises: ConfigError; its text never contains the password.
    """
    _client(uri, connect=False).close()


def _client(uri: str, **options: Any) -> MongoClient[Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # pymongo only warns of an unknown option
            return MongoClient(uri, **options)
    except (PyMongoError, ValueError, TypeError, UserWarning) as error:
        raise ConfigError(_uri_error(uri, error)) from None


def _uri_error(uri: str, error: Exception) -> str:
    secret = password_in(uri)
    shown = without_password(uri).partition("?")[0]  # options may contain secrets
    text = f"mongodb_uri {shown!r}: {error}"
    return f"{text.replace(secret, '***') if secret else text}; expected mongodb://host:port"


def to_filter(query: Query) -> dict[str, Any]:
    """The part of a query that the indexes of the database answer; the client checks the pattern again."""
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
    """Converts errors of pymongo into SwarmError."""
    try:
        yield
    except OperationFailure as error:
        kind = Denied if error.code in _DENIALS else SwarmError
        raise kind(f"MongoDB: {_short(str(error))}") from error
    except PyMongoError as error:
        raise NoAnswer(f"MongoDB: {_short(str(error))}") from error


def _short(text: str) -> str:
    """One line of an error: the driver adds its time-outs and the topology of all servers."""
    text = _TIMEOUTS.sub("", text.split(", Timeout:", maxsplit=1)[0].split(", full error:", maxsplit=1)[0])
    return text if len(text) <= _LINE else text[: _LINE - 1] + "…"
