"""Record of the changes that this platform was asked for, also of refused ones, kept over restarts."""

import asyncio
import logging
import re
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from swarmd.tree.core.structure.index import pattern
from swarmware.errors import InvalidInput
from swarmware.model import names
from swarmware.model.clock import utc_ns
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.tree import LoggedChange, TreeChange, TreeLog, TreeLogQuery

FILE: Final = "changes.jsonl"
"""Name of the file in the data folder of the node; `changes.1.jsonl` has the changes before."""
FILE_BYTES: Final = 512 * 1024
"""Size from which a new file is begun."""
KEPT: Final = 2000
"""Maximum number of changes in memory."""
REPLY_LIMIT: Final = 500
"""Maximum number of changes in a reply, which must fit into a frame."""
_ALL: Final = "**"
_ALTERNATIVES: Final = re.compile(r"\{([^,}]*)[^}]*\}")
TEXT_LIMIT: Final = 2000
"""Maximum characters of a value in the record; the rest of a larger one is cut off."""

log = logging.getLogger("swarm.tree")


class ChangeLog:
    """Writes each change to a file and the event `tree/changes`; serves `sys/tree/log`."""

    def __init__(self, module: Module, changes: BoardWriter[TreeChange], path: Path) -> None:
        self._module = module
        self._changes = changes
        self._of_broker = module.stream_reader("net/changes", TreeChange)
        self._path = path
        self._former = path.with_suffix(f".1{path.suffix}")
        self._writing = asyncio.Lock()
        self._ends_whole = False
        """Whether the file ends with a whole line, as far as is known."""
        self._kept: deque[LoggedChange] = deque(maxlen=KEPT)
        for file in (self._former, path):
            self._kept.extend(_read(file))

    async def follow_broker(self) -> None:
        """Records the changes of channels, until cancelled."""
        async for change in self._of_broker:
            await self.record(change)

    def serve(self) -> None:
        """Registers the handler of the request."""
        self._module.serve("sys/tree/log", TreeLogQuery, self._query, reply=TreeLog)

    async def record(self, change: TreeChange) -> None:
        """Record a change or its refusal."""
        # the event first: it must not wait for the disk
        self._changes.write(change)
        short = msgspec.structs.replace(change, before=_cut(change.before), after=_cut(change.after))
        logged = LoggedChange(utc_ns(), short)
        self._kept.append(logged)
        # one line at a time: two threads would mix the bytes of their lines
        async with self._writing:
            try:
                await asyncio.to_thread(self._append, msgspec.json.encode(logged) + b"\n")
            except OSError as error:
                log.warning("change of %s is not on the disk: %s: %s", change.path, self._path, error)

    def _append(self, line: bytes) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if self._path.exists() and self._path.stat().st_size + len(line) > FILE_BYTES:
            self._path.replace(self._former)
        with self._path.open("ab") as file:
            if file.tell() and not self._ends_whole:
                line = b"\n" + line  # a crash has cut the last one
            self._ends_whole = False
            file.write(line)
        self._ends_whole = True

    def _query(self, query: TreeLogQuery, _: Meta) -> TreeLog:
        pattern(query.pattern)
        found = [
            one
            # the newest first: the reply has room for a part only
            for one in reversed(self._kept)
            if one.utc_ns >= query.since_utc_ns
            and query.by in one.change.by
            and (one.change.refused or not query.refused)
            and _concerns(query.pattern, names.split(one.change.path)[1])
        ]
        shown = max(1, min(query.limit, REPLY_LIMIT))
        return TreeLog(self._module.platform, tuple(found[:shown]), max(0, len(found) - shown))


def _concerns(query: str, path: str) -> bool:
    """Whether a query asks for a change, which may be the change of a rule, whose path is a pattern."""
    if query in {_ALL, path} or pattern(query).matches(path):
        return True
    try:
        rule = pattern(path)
    except InvalidInput:
        return False  # of a request that was refused
    example = _ALTERNATIVES.sub(r"\1", path).replace("*", "x")
    return not rule.literal and (rule.matches(query) or pattern(query).matches(example))


def _read(file: Path) -> Iterator[LoggedChange]:
    """The changes of a file; a line that was cut by a crash is left out."""
    try:
        lines = file.read_bytes().splitlines()
    except FileNotFoundError:
        return
    except OSError as error:
        log.warning("record of changes: %s: %s", file, error)
        return
    decoder = msgspec.json.Decoder(LoggedChange)
    invalid = 0
    for line in filter(None, lines[-KEPT:]):
        try:
            yield decoder.decode(line)
        except (msgspec.DecodeError, ValueError, RecursionError):
            invalid += 1
    if invalid:
        log.warning("record of changes: %s: %d lines cannot be read", file, invalid)


def _cut(text: str) -> str:
    return text if len(text) <= TEXT_LIMIT else f"{text[:TEXT_LIMIT]}…"
