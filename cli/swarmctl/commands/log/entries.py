"""Log entries that the options of a command select: their source, printed, exported, counted."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from swarmctl.commandline.nodes import EVERY, NodeSelection
from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log import export
from swarmctl.commands.log.origins import origins as map_origins
from swarmctl.commands.log.run_span import run_span
from swarmctl.resources.values import brief
from swarmctl.session import labs
from swarmctl.session.session import config_dir
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import span_s, utc_text
from swarmctl.terminal.table import Column
from swarmctl.terminal.wrapping import wrapped
from swarmctl.viewers.lost_values import LostValues
from swarmware.errors import InvalidInput, NotFound, Partial, SwarmError
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.model.config import load_node, load_service
from swarmware.model.names import Pattern
from swarmware.recorder.address import database_in
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.foreign_log import refuse_foreign
from swarmware.recorder.query import FolderSource, LogSource, Query, QueueStats, stats
from swarmware.types.json_form import text_form


class PrintedEntry(msgspec.Struct, frozen=True):
    """One log entry as a line of JSON."""

    utc: str
    """Wall clock of the logger, ISO 8601."""
    utc_ns: int
    stamp_ns: int
    """Clock of the platform when the value was sent."""
    path: str
    type: str
    queue: str
    sequence: int
    """Number in the queue."""
    sender: str
    """Sender of a command, or "" for another entry."""
    value: Any


class LoggerAddress(msgspec.Struct, frozen=True):
    """Keys of logger.toml: the database to which the log is forwarded."""

    mongodb_uri: str = ""
    mongodb_database: str = "swarm"


class LogStatistics(msgspec.Struct, frozen=True):
    """Number of entries of each queue."""

    queues: list[QueueStats]


def print_entries(options: Mapping[str, Any], out: Output) -> None:
    """Prints the entries that the options name.

    Raises: Partial when a part of the log could not be read; as `source`.
    """
    with source(out.settings, options) as found:
        count = 0
        for entry in _selected(found, options, out):
            show(out, entry)
            count += 1
    if not count:
        out.say(found.why_empty() or "no entry matches")
    refuse_losses(found)


def _selected(found: LogSource, options: Mapping[str, Any], out: Output) -> Iterator[LogEntry]:
    """The entries that the options name; reports whether `--limit` leaves others out."""
    wanted = query(out.settings, options)
    if wanted.limit is None:
        yield from found.entries(wanted)
        return
    # one more than wanted, to know whether there are others
    entries = list(found.entries(msgspec.structs.replace(wanted, limit=wanted.limit + 1)))
    others = len(entries) > wanted.limit
    yield from entries[-wanted.limit :] if wanted.newest else entries[: wanted.limit]
    if others:
        out.say(f"--limit {wanted.limit}: {'older' if wanted.newest else 'newer'} entries are left out")


def export_entries(options: Mapping[str, Any], form: str, target: str, out: Output) -> None:
    """Writes the entries that the options name to a file.

    Raises: NotFound when no entry matches; Partial when a part could not be read, or the format cannot hold
    a value; as `source`.
    """
    lost = LostValues()
    with source(out.settings, options) as found:
        origins = map_origins(options, out) if form == "mcap" else {}
        count = export.export(_selected(found, options, out), form, target, origins, lost)
    out.say(f"{count} entries to {target}")
    refuse_losses(found)
    lost.refuse()


def count_entries(options: Mapping[str, Any], out: Output, *, strict: bool) -> None:
    """Prints the number of entries and of missing entries of each queue.

    Raises: Partial when a part could not be read, or with `strict` when entries are missing.
    """
    with source(out.settings, options) as found:
        queues = stats(found.entries(Query()))
    if out.settings.structured:
        out.document(LogStatistics(queues))
    else:
        rows = [
            (q.queue, q.entries, q.bytes, q.missing, (q.last_utc_ns - q.first_utc_ns) / 1e9) for q in queues
        ]
        columns = [
            Column("QUEUE"),
            Column("ENTRIES", right=True),
            Column("BYTES", right=True),
            Column("MISSING", right=True),
            Column("SPAN s", right=True),
        ]
        out.table(columns, rows, empty="the log has no entries")
    refuse_losses(found)
    if strict and (missing := sum(queue.missing for queue in queues)):
        raise Partial(f"log: {missing} entries are missing; expected none")


@contextmanager
def source(settings: CliSettings, options: Mapping[str, Any]) -> Iterator[LogSource]:
    """The source that the options name: a database, a folder, or the rings of the nodes on this machine."""
    if options.get("mongodb"):
        from swarmware.recorder.mongo import MongoStore

        uri, name = database(settings, options["mongodb"], options.get("database") or "")
        store = MongoStore(uri, name, timeout_s=settings.timeout_s, answer_s=5 * settings.timeout_s)
        try:
            yield store
        finally:
            store.close()
        return
    if spool := options.get("spool"):
        from swarmware.recorder.spool import SpoolSource

        try:
            file = sys.stdin.buffer if spool == "-" else Path(spool).open("rb")  # noqa: SIM115  # closed below
        except OSError as error:
            raise NotFound(f"spool {spool}: {error.strerror}; expected a file of MessagePack") from error
        with file:
            yield SpoolSource(file, spool)
        return
    yield FolderSource(folders(settings, options.get("folder")))


def database(settings: CliSettings, uri: str, name: str) -> tuple[str, str]:
    """Address and name of the database: the given ones, else those to which the lab or node forwards.

    Raises: NotFound for `-` when logs are not forwarded.
    """
    written_uri, written = _forwarded(settings)
    if uri == "-":
        if not written_uri:
            raise NotFound("--mongodb -: the logs are not forwarded; expected a lab with --mongodb, or a URI")
        uri = written_uri
    return uri, name or database_in(uri) or written or "swarm"


def _forwarded(settings: CliSettings) -> tuple[str, str]:
    """Address and name of the database to which the lab or node forwards, or "" without one."""
    lab = labs.chosen(settings)
    if lab is not None:
        return lab.mongodb_uri, lab.mongodb_database if lab.mongodb_uri else ""
    try:
        folder = config_dir(settings)
        load_node(folder)
    except SwarmError:
        return "", ""  # no node here: the address has the name
    found = load_service(folder, "logger", LoggerAddress)
    return found.mongodb_uri, found.mongodb_database if found.mongodb_uri else ""


def folders(settings: CliSettings, folder: str | None) -> list[Path]:
    """Folders of segments: the given folder, the folders of a lab's nodes, or the node's own folder.

    Raises: NotFound when there are no segments, InvalidInput for a log of another program.
    """
    if folder:
        root = Path(folder)
        found = sorted({path.parent for path in root.rglob("*.mcap")}) if root.is_dir() else []
        if not found:
            refuse_foreign(root)
            raise NotFound(f"log folder {folder}: no segments (*.mcap) in it")
        return found
    lab = labs.chosen(settings)
    if lab is not None:
        return [path for node in lab.select(settings.node) if (path := paths.log(node.data_dir)).is_dir()]
    node = load_node(config_dir(settings))
    # logs stay on the computer that wrote them, so another node's are not here
    if settings.node and not NodeSelection(settings.node).matches(node.platform):
        raise NotFound(
            f"log of {settings.node}: not on this machine; expected --mongodb URI, or swarmctl on its machine"
        )
    return [paths.log(node.data_path)]


def absolute(pattern: str, settings: CliSettings) -> str:
    """A pattern with its platforms, from `-n` or else all platforms."""
    platforms = NodeSelection(settings.node or EVERY).pattern
    return pattern if pattern.startswith("/") else f"/{platforms}/{pattern}"


def query(settings: CliSettings, options: Mapping[str, Any]) -> Query:
    """The query in a command's options.

    Raises: InvalidInput for a time that cannot be parsed; NotFound for an unknown run.
    """
    now_ns = utc_ns()
    since_ns = instant_ns(options["since"], now_ns) if options["since"] else None
    until_ns = instant_ns(options["until"], now_ns) if options["until"] else None
    if options["run_id"]:
        begin_ns, end_ns = run_span(settings, options["run_id"])
        since_ns = begin_ns if since_ns is None else max(begin_ns, since_ns)
        ends = [each for each in (end_ns, until_ns) if each is not None]
        until_ns = min(ends, default=None)
    return Query(
        pattern=Pattern(absolute(options["pattern"], settings)).text,
        types=tuple(options["types"]),
        since_ns=since_ns,
        until_ns=until_ns,
        limit=options["limit"],
        newest=not options["oldest"],
    )


def instant_ns(text: str, now_ns: int) -> int:
    """Parse an instant: a duration before now, or an ISO date.

    Raises: InvalidInput for any other text.
    """
    try:
        return now_ns - round(span_s(text.removesuffix(" ago")) * 1e9)
    except InvalidInput:
        pass  # then it is a date
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise InvalidInput(f"time {text!r}: expected 30s, 5m, 2h, 1d or an ISO date with Z") from None
    # a date without a zone is UTC, as all printed times are
    return round((found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp() * 1e9)


def show(out: Output, entry: LogEntry) -> None:
    """Print one entry, as a line of JSON or of text."""
    if out.settings.structured:
        out.line(
            PrintedEntry(
                utc_text(entry.utc_ns),
                entry.utc_ns,
                entry.stamp_ns,
                entry.topic,
                entry.type,
                entry.queue,
                entry.sequence,
                entry.sender,
                _value(entry),
            )
        )
        return
    sender = f"  from {entry.sender}" if entry.sender else ""
    head = f"{utc_text(entry.utc_ns)}  {entry.topic:<28} {entry.type:<14}"
    value = f"{brief(entry.plain())}{sender}"
    if out.width is None or len(head) + 1 + len(value) <= out.width:
        out.now(f"{head} {value}")
    else:
        out.now(head.rstrip(), *wrapped(value, out.width, "    ", "    "))


def _value(entry: LogEntry) -> Any:
    """The value for programs, with bytes as base64, or None if it is nested too deep for the interpreter."""
    try:
        return text_form(entry.content())
    except RecursionError:
        return None


def refuse_losses(found: LogSource) -> None:
    """Check that all parts of the log could be read.

    Raises: Partial naming the others.
    """
    if losses := found.losses():
        more = f"; and {len(losses) - 3} more" if len(losses) > 3 else ""
        raise Partial(f"the log is incomplete: {'; '.join(losses[:3])}{more}")
