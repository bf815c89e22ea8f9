"""Cache for the completion of fields, values and missions that commands have met, in one file of the user."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from swarmctl.commandline import completion_cache
from swarmware import __version__
from swarmware.runtime.filewriter import replace_file

LIMIT: Final = 20_000
"""Maximum number of paths, the same as in the cache of paths."""

FieldValues = dict[str, list[str]]
"""Dotted names of fields, each with its permitted values; an empty list permits any value."""


class CachedWords(NamedTuple):
    """Words of one swarm."""

    way: str
    """Configuration folder of the joined node."""
    types: dict[str, str]
    """Type of a resource, or of the request of a command, by its global path."""
    fields: dict[str, FieldValues]
    """Fields by the name of a type, or by the path of a resource with values of its own."""
    missions: list[str]
    hints: dict[str, str]
    """Permitted values and default of a setting, by its global path."""


def file() -> Path:
    """File of the words, `words.json` beside the cache of paths."""
    return completion_cache.file().with_name("words.json")


def empty(way: str = "") -> CachedWords:
    """Empty words, as of a swarm that was never listed."""
    return CachedWords(way, {}, {}, [], {})


def load() -> CachedWords:
    """The stored words, or empty ones without a valid file."""
    try:
        found: Any = json.loads(file().read_bytes())
        if found["version"] != __version__:
            return empty()  # another version's types may have other fields
        fields = {
            str(name): {str(field): [str(value) for value in values] for field, values in known.items()}
            for name, known in found["fields"].items()
        }
        types = {str(path): str(name) for path, name in found["types"].items()}
        hints = {str(path): str(text) for path, text in found.get("hints", {}).items()}
        return CachedWords(str(found["way"]), types, fields, [str(name) for name in found["missions"]], hints)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return empty()


def save(
    way: str,
    types: Mapping[str, str] | None = None,
    fields: Mapping[str, FieldValues] | None = None,
    missions: Iterable[str] | None = None,
    hints: Mapping[str, str] | None = None,
) -> None:
    """Adds words that were met through a node; another joined node removes all former words."""
    before = load()
    known = before if before.way == way else empty(way)
    merged = CachedWords(
        way,
        # the newest stay
        dict(list({**known.types, **(types or {})}.items())[-LIMIT:]),
        {**known.fields, **(fields or {})},
        known.missions if missions is None else list(missions),
        {**known.hints, **(hints or {})},
    )
    # most commands meet the same words again
    if merged == before:
        return
    target = file()
    try:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        content = json.dumps({"version": __version__, **merged._asdict()}, separators=(",", ":")).encode()
        replace_file(target, content, mode=0o600, durable=False)
    except OSError:
        return  # without a writable home there is no completion of fields


def fields_of(path: str, platform: str) -> FieldValues:
    """Fields of the resource at a path; a path without a platform belongs to `platform`, or to any if ""."""
    words = load()
    full = _full(path, platform, words.types)
    return words.fields.get(full) or words.fields.get(words.types.get(full, ""), {})


def values_of(path: str, platform: str) -> tuple[list[str], str]:
    """Values to offer for a setting, and its hint; the path is resolved as in `fields_of`."""
    words = load()
    full = _full(path, platform, {**words.types, **words.hints})
    known = words.fields.get(full) or words.fields.get(words.types.get(full, ""), {})
    return known.get("value", []), words.hints.get(full, "")


def _full(path: str, platform: str, paths: Iterable[str]) -> str:
    if path.startswith("/"):
        return path
    ending = f"/{path}"
    known = (one for one in paths if one.endswith(ending) and one.count("/") == path.count("/") + 2)
    return f"/{platform}/{path}" if platform else next(known, path)
