"""Cache for shell completion: platforms and paths that a command has listed, in one file of the user."""

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from swarmctl.commandline.nodes import NodeSelection
from swarmware.runtime.filewriter import replace_file

LIMIT: Final = 20_000
"""Maximum number of paths, about 1 MB, which are read within 20 ms."""

KEY: Final = "key"
"""Kind of the rows that are keys of configuration files, below config/."""
VALUED: Final = frozenset({"board", "event", "stream", "setting"})
"""Kinds of resources that have a value."""


class CachedResource(NamedTuple):
    """Resource as the completion shows it."""

    path: str
    kind: str
    access: str


def file() -> Path:
    """File of the cache: $XDG_CACHE_HOME/swarm/seen.json, else below ~/.cache."""
    root = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(root) if root else Path("~/.cache").expanduser()) / "swarm" / "seen.json"


def load() -> tuple[str, list[str], list[CachedResource]]:
    """Joined node, platforms and resources, all empty without a valid file."""
    try:
        found: Any = json.loads(file().read_bytes())
        rows = [CachedResource(*map(str, row)) for row in found["resources"]]
        return str(found["way"]), [str(name) for name in found["platforms"]], rows
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "", [], []


def save(
    way: str, platforms: Iterable[str], listed: Iterable[CachedResource] = (), whole: Iterable[str] = ()
) -> None:
    """Adds platforms and resources that were listed through a node.

    `whole`: platforms whose list is complete, so that their former resources are removed.
    Another joined node may belong to another swarm, so it removes all former entries.
    """
    before, known, old = load()
    gone = set(whole)
    same = old if before == way else []
    kept = {row.path: row for row in same if row.kind == KEY or row.path.split("/", 2)[1] not in gone}
    kept |= {row.path: row for row in listed}
    names, rows = list(platforms), list(kept.values())
    # an unchanged list is not written: most commands list the same again
    if (before, known, old) != (way, names, rows):
        _write(way, names, rows)


def save_keys(way: str, platform: str, keys: Iterable[tuple[str, bool]]) -> None:
    """Replaces the keys of a platform's configuration by pairs of a name and whether it is live."""
    from swarmware.model import names, paths  # not at the top: a completion must start fast

    before, platforms, old = load()
    prefix = names.join(platform, paths.setting(""))
    same = old if before == way else []
    kept = {row.path: row for row in same if row.kind != KEY or not row.path.startswith(prefix)}
    for name, live in keys:
        row = CachedResource(f"{prefix}{name}", "setting" if live else KEY, "rw" if live else "r")
        kept[row.path] = row
    _write(way, dict.fromkeys([*(platforms if before == way else ()), platform]), kept.values())


def _write(way: str, platforms: Iterable[str], rows: Iterable[CachedResource]) -> None:
    content = {"way": way, "platforms": list(platforms), "resources": list(rows)[:LIMIT]}
    target = file()
    try:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        # not durable: a lost cache is filled again by the next list
        replace_file(target, json.dumps(content, separators=(",", ":")).encode(), mode=0o600, durable=False)
    except OSError:
        return  # without a writable home there is no completion of paths


def steps(paths: Iterable[str], begun: str) -> list[str]:
    """Completions up to the next segment, as for files; a single branch is entered at once."""
    fitting = [path for path in paths if path.startswith(begun)]
    at = len(begun)
    while True:
        found = dict.fromkeys(_cut(path, at) for path in fitting)
        if len(found) != 1:
            return list(found)
        only = next(iter(found))
        if not only.endswith("/"):
            return [only]
        at = len(only)


def _cut(path: str, at: int) -> str:
    slash = path.find("/", at + (1 if at == 0 else 0))
    return path if slash < 0 else path[: slash + 1]


def local(rows: Iterable[CachedResource], platform: str) -> Iterator[str]:
    """Paths without their platform, of the selected platforms or of all without a selection."""
    selected = NodeSelection(platform).matches if platform else None
    for row in rows:
        _, name, path = row.path.split("/", 2) if row.path.count("/") > 1 else ("", "", "")
        if path and (selected is None or selected(name)):
            yield path
