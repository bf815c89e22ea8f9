"""Completion of arguments for the shell, from a cache, without a connection to a node."""

import os
import re
from collections.abc import Callable, Container
from typing import Any

import click

from swarmctl.commandline.settings import settings

Completer = Callable[[click.Context, click.Parameter, str], list[Any]]


def platforms(incomplete: str) -> list[str]:
    """Platforms in the cache that begin with the typed text."""
    from swarmctl.commandline import completion_cache

    return [name for name in completion_cache.load()[1] if name.startswith(incomplete)]


def default_labs_folder() -> str:
    """Folder of this user's labs unless the environment names another one."""
    return f"/tmp/swarm-{os.getuid()}"


def labs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Labs of this user that begin with the typed text."""
    folder = os.environ.get("SWARMCTL_LABS") or default_labs_folder()
    try:
        return sorted(e.name for e in os.scandir(folder) if e.is_dir() and e.name.startswith(incomplete))
    except OSError:
        return []


def resources(kinds: Container[str], access: str = "r", *, fields: bool = False) -> Completer:
    """Completer of paths of resources of these kinds, with their platform if a slash was typed.

    `fields`: completes also the fields of a resource after a dot.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
        from swarmctl.commandline import completion_cache
        from swarmware.model.names import split_field

        if fields and "." in incomplete.rpartition("/")[2]:
            path, begun = split_field(incomplete)
            known = [name for name in _fields(ctx, path) if name != "value"]
            return [f"{path}.{name}" for name in known if name.startswith(begun)]
        rows = [row for row in completion_cache.load()[2] if row.kind in kinds and access in row.access]
        if incomplete.startswith("/") or not (incomplete or settings(ctx).node):
            return completion_cache.steps((row.path for row in rows), incomplete)
        return completion_cache.steps(
            dict.fromkeys(completion_cache.local(rows, settings(ctx).node)), incomplete
        )

    return complete


def config_keys(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Keys of the configuration: of files, and live settings."""
    return _keys(ctx, incomplete, "r")


def live_settings(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Keys that may be set while the node runs."""
    return _keys(ctx, incomplete, "rw")


def _keys(ctx: click.Context, incomplete: str, access: str) -> list[str]:
    from swarmctl.commandline import completion_cache

    kinds = {"setting", completion_cache.KEY}
    rows = [row for row in completion_cache.load()[2] if row.kind in kinds and access in row.access]
    paths = dict.fromkeys(completion_cache.local(rows, settings(ctx).node))
    return completion_cache.steps((path.removeprefix("config/") for path in paths), incomplete)


def field_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Fields of the resource in the argument `path`."""
    # after an option without its value no argument is parsed yet
    given = ctx.params.get("path") or next(iter(ctx.args), "")
    return [name for name in _fields(ctx, str(given)) if name.startswith(incomplete)]


def values(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Values of the enumeration or truth value that the argument `path` names."""
    from swarmware.model.names import split_field

    path, field = split_field(str(ctx.params.get("path", "")))
    return [value for value in _fields(ctx, path).get(field or "value", ()) if value.startswith(incomplete)]


def setting_values(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Values of the setting in the argument `key`, with its range and default as help."""
    from click.shell_completion import CompletionItem

    from swarmctl.commandline import word_cache
    from swarmctl.commandline.nodes import names_one
    from swarmware.model import paths

    node, key = settings(ctx).node, str(ctx.params.get("key", ""))
    found, hint = word_cache.values_of(paths.setting(key), node if names_one(node) else "")
    return [CompletionItem(value, help=hint) for value in found if value.startswith(incomplete)]


def field_values(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Words `field=value` for the type of the argument `path`; bash splits them at the equals sign."""
    known = _fields(ctx, str(ctx.params.get("path", "")))
    given = [str(word) for word in ctx.params.get(param.name or "") or ()]
    # bash passes `field=` as the words `field` and `=`, or as `field` and an empty word
    if given and given[-1] in known and not incomplete:
        return known[given[-1]]
    if len(given) > 1 and given[-1] == "=":
        return [value for value in known.get(given[-2], ()) if value.startswith(incomplete)]
    name, equals, begun = incomplete.partition("=")
    if equals:
        return [f"{name}={value}" for value in known.get(name, ()) if value.startswith(begun)]
    if known.keys() == {"value"}:
        return [value for value in known["value"] if value.startswith(incomplete)]
    used = {word.partition("=")[0] for word in given}
    return [f"{field}=" for field in known if field.startswith(incomplete) and field not in used]


def condition_words(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Fields for a condition on the resource in the argument `path`, or their values after a comparison."""
    known = _fields(ctx, str(ctx.params.get("path", "")))
    if compared := re.search(r"([\w.]+)\s*[!=]=\s*(['\"]?)(\w*)$", incomplete):
        field, quote, begun = compared.groups()
        head = incomplete[: compared.start(2)]
        shown = [value for value in known.get(field, ()) if value.startswith(begun)]
        return [f"{head}{_literal(value, quote)}" for value in shown]
    begun = re.search(r"[\w.]*$", incomplete)[0]  # type: ignore[index]  # matches every text
    head = incomplete.removesuffix(begun)
    return [f"{head}{name}" for name in known if name.startswith(begun)]


def _literal(value: str, quote: str) -> str:
    quote = quote or ("" if value in {"true", "false"} else "'")
    return f"{quote}{value}{quote}"


def missions(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Missions of this installation and of the ground station if they were listed, else files."""
    from click.shell_completion import CompletionItem

    from swarmctl.commandline import word_cache
    from swarmware.model.config import share_dir

    try:
        shipped = [entry.name for entry in os.scandir(share_dir() / "missions") if entry.is_dir()]
    except OSError:
        shipped = []
    found = [name for name in sorted({*shipped, *word_cache.load().missions}) if name.startswith(incomplete)]
    return [*found] or [CompletionItem(incomplete, type="file")]


def _fields(ctx: click.Context, path: str) -> dict[str, list[str]]:
    from swarmctl.commandline import word_cache
    from swarmctl.commandline.nodes import names_one

    node = settings(ctx).node
    return word_cache.fields_of(path, node if names_one(node) else "")


def services(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Services of the selected platforms, recognised by their boards `app/NAME/status`."""
    from swarmctl.commandline import completion_cache

    paths = completion_cache.local(completion_cache.load()[2], settings(ctx).node)
    found = (path.split("/")[1] for path in paths if path.startswith("app/") and path.endswith("/status"))
    return [name for name in dict.fromkeys(found) if name.startswith(incomplete) and name != "swarmctl"]
