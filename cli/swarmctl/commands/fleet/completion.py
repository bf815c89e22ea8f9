"""Completion of the names of hosts from the file of the command line."""

import tomllib
from pathlib import Path


def host_names(file: str, begun: str) -> list[str]:
    """Names of hosts in this file that begin so; none where it cannot be read."""
    try:
        found = tomllib.loads(Path(file).read_text("utf-8")).get("hosts", [])
        names = [str(one["name"]) for one in found if "name" in one]
    except (OSError, ValueError, TypeError, AttributeError):
        return []
    return [name for name in names if name.startswith(begun)]
