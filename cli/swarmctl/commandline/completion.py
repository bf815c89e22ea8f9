"""Completion of arguments for the shell, from a cache, without a connection to a node."""

import os
from collections.abc import Callable, Container
from typing import Any

import click

from swarmctl.commandline.settings import settings

Completer = Callable[[click.Context, click.Parameter, str], list[Any]]


def platforms(incomplete: str) -> list[str]:
    """Platforms in the cache."""
    from swarmctl.commandline import completion_cache

    return [name for name in completion_cache.load()[1] if name.startswith(incomplete)]


def default_labs_folder() -> str:
    """Folder of this user's labs, unless the environment names another."""
    return f"/tmp/swarm-{os.getuid()}"


def labs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Labs of this user."""
    folder = os.environ.get("SWARMCTL_LABS") or default_labs_folder()
    try:
        return sorted(e.name for e in os.scandir(folder) if e.is_dir() and e.name.startswith(incomplete))
    except OSError:
        return []


def resources(kinds: Container[str], access: str = "r") -> Completer:
    """Paths of resources of these kinds, with their platform when a slash was typed, else without."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
        from swarmctl.commandline import completion_cache

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
