"""Where the record is, as an operator names it, and how an entry looks to people."""

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from swarmctl.connect import config_dir
from swarmctl.lab import record as labs
from swarmctl.output import Output
from swarmctl.quantities import span_s
from swarmctl.settings import Settings
from swarmware.clock import utc_ns
from swarmware.config import load_node
from swarmware.errors import InvalidInput, NotFound
from swarmware.module import Module
from swarmware.names import Pattern
from swarmware.record.entry import Entry
from swarmware.record.query import FolderSource, Query, Source
from swarmware.record.ring import segments
from swarmware.record.segment import SegmentReader
from swarmware.types.log import LogStats


@contextmanager
def source(settings: Settings, options: Mapping[str, Any]) -> Iterator[Source]:
    """The place that the options name: a database, a folder, or the rings of the nodes on this machine."""
    if options.get("mongodb"):
        from swarmware.record.mongo import MongoStore

        store = MongoStore(options["mongodb"], options["database"], timeout_s=settings.timeout_s)
        try:
            yield store
        finally:
            store.close()
        return
    yield FolderSource(folders(settings, options.get("folder")))


def folders(settings: Settings, folder: str | None) -> list[Path]:
    """Folders of segments: the one given, those of a lab's nodes, or that of the node itself.

    Raises: NotFound when nothing is recorded there.
    """
    if folder:
        root = Path(folder)
        found = sorted({path.parent for path in root.rglob("*.mcap")}) if root.is_dir() else []
        if not found:
            raise NotFound(f"log folder {folder}: no segments (*.mcap) in it")
        return found
    if settings.config_dir is None:
        try:
            lab = labs.find(settings.lab)
        except NotFound:
            if settings.lab:
                raise
        else:
            nodes = [lab.node(settings.node)] if settings.node else list(lab.nodes)
            return [path for node in nodes if (path := node.data_dir / "log").is_dir()]
    node = load_node(config_dir(settings))
    if settings.node and settings.node != node.platform:
        raise NotFound(f"log of {settings.node}: not on this machine; expected --mongodb URI, or to be there")
    return [node.data_path / "log"]


def query(options: Mapping[str, Any]) -> Query:
    """The query in a command's options."""
    now_ns = utc_ns()
    return Query(
        pattern=Pattern(options["pattern"]).text,
        types=tuple(options["types"]),
        since_ns=instant_ns(options["since"], now_ns) if options["since"] else None,
        until_ns=instant_ns(options["until"], now_ns) if options["until"] else None,
        limit=options["limit"],
        newest=options["newest"],
    )


def instant_ns(text: str, now_ns: int) -> int:
    """An instant as people write it: so long ago, or a date.

    Raises: InvalidInput when it is neither.
    """
    try:
        return now_ns - round(span_s(text.removesuffix(" ago")) * 1e9)
    except InvalidInput:
        pass  # then it is a date
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise InvalidInput(f"time {text!r}: expected 30s, 5m, 2h, 1d or an ISO date with Z") from None
    return round((found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp() * 1e9)


def show(out: Output, entry: Entry) -> None:
    """One entry: a line of JSON, or a line for people."""
    if out.settings.json:
        out.line(
            {
                "utc": iso(entry.utc_ns),
                "utc_ns": entry.utc_ns,
                "stamp_ns": entry.stamp_ns,
                "path": entry.topic,
                "type": entry.type,
                "queue": entry.queue,
                "sequence": entry.sequence,
                "value": entry.plain(),
            }
        )
        return
    value = msgspec.json.encode(entry.plain()).decode()
    out.text(f"{iso(entry.utc_ns)}  {entry.topic:<28} {entry.type:<14} {value}")


def iso(instant_utc_ns: int) -> str:
    """ISO 8601 with milliseconds and Z."""
    moment = datetime.fromtimestamp(instant_utc_ns // 1_000_000 / 1000, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def follow(settings: Settings, pattern: str, folder: str | None) -> Iterator[Entry]:
    """Entries from now on, as the logger ends its batches."""
    matcher = Pattern(pattern)
    if folder is not None or settings.config_dir is not None or not settings.node:
        place = (
            folders(settings, folder)[:1] if folder else [load_node(config_dir(settings)).data_path / "log"]
        )
        joined = config_dir(settings)
    else:
        node = labs.find(settings.lab).node(settings.node)
        place, joined = [node.data_dir / "log"], node.config_dir
    with asyncio.Runner() as runner:
        batches = _Batches(place[0], joined)
        try:
            runner.run(batches.open())
            while True:
                for entry in runner.run(batches.next()):
                    if matcher.matches(entry.topic):
                        yield entry
        finally:
            runner.run(batches.close())


class _Batches:
    """Waits on the logger's own report, then reads what is new in the newest segments."""

    def __init__(self, directory: Path, folder: Path) -> None:
        self._directory = directory
        self._module = Module("swarmctl", config_dir=folder)
        self._reader: SegmentReader | None = None

    async def open(self) -> None:
        await self._module.__aenter__()
        self._stats = await self._module.reader("log/stats", LogStats)
        self._new()

    async def next(self) -> list[Entry]:
        await self._stats.changed()
        return self._new()

    def _new(self) -> list[Entry]:
        paths = segments(self._directory)
        if self._reader is None:
            if paths:
                self._reader = SegmentReader(paths[-1])
                for _ in self._reader.entries():
                    pass  # what is there already was not asked for
            return []
        out = list(self._reader.entries())
        for path in paths:
            if int(path.stem) > int(self._reader.path.stem):
                self._reader = SegmentReader(path)
                out += self._reader.entries()
        return out

    async def close(self) -> None:
        await self._module.__aexit__(None, None, None)
