"""Changes of a file of hosts (HOSTS.toml): adds, removes or renames an entry and keeps all other text."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from swarmctl.membership.hosts import parse_hosts
from swarmware.errors import Conflict, InvalidInput
from swarmware.model import document
from swarmware.runtime.filewriter import replace_file

_HEADER: Final = re.compile(r"\s*\[\[?\s*(?P<name>[\w.\"'-]+)\s*\]?\]\s*(#.*)?\n?")
_NAME: Final = re.compile(r"(?P<key>\s*name\s*=\s*)(?P<value>\"[^\"]*\"|'[^']*')(?P<rest>.*)", re.DOTALL)
MODE: Final = 0o644


def host_lines(name: str, address: str, node: dict[str, str]) -> str:
    """The text of an entry in the file of hosts."""
    import tomli_w

    text = "\n[[hosts]]\n" + tomli_w.dumps({"name": name, "address": address})
    return text + "[hosts.node]\n" + tomli_w.dumps(node) if node else text


def add_host(path: Path, name: str, address: str, node: dict[str, str]) -> bool:
    """Add an entry, to a new file if it is missing. Returns False if the same entry exists already.

    Raises: Conflict when the name is taken by another host; ConfigError, OSError.
    """
    try:
        before = document.read(path)
    except FileNotFoundError:
        before = ""
    known = _names(before, path)
    if name in known:
        # the same call again is not an error, so that an interrupted addition can be repeated
        if known[name] == address:
            return False
        raise Conflict(f"{path}: host {name!r} has address {known[name]}; expected it, or another name")
    _write(path, before.rstrip("\n") + "\n" + host_lines(name, address, node), [*known, name])
    return True


def remove_hosts(path: Path, names: tuple[str, ...]) -> list[str]:
    """Remove the entries of these hosts; returns the names that had an entry.

    Raises: InvalidInput for the last host of a file, and if an entry is not a table `[[hosts]]`;
    ConfigError, OSError.
    """
    text = document.read(path)
    known = _names(text, path)
    found = [name for name in known if name in names]
    if len(found) == len(known):
        raise InvalidInput(f"{path}: no host would remain; expected another one, or the file to be removed")
    if found:
        kept = [part for part, host in _parts(text, list(known)) if host not in found]
        _write(path, "".join(kept), [name for name in known if name not in found])
    return found


def rename_host(path: Path, name: str, other: str) -> bool:
    """Rename an entry; returns whether there was one. Raises: as `remove_hosts`."""
    text = document.read(path)
    known = list(_names(text, path))
    if name not in known:
        return False

    def renamed(part: str) -> str:
        lines = part.splitlines(keepends=True)
        for number, line in enumerate(lines):
            found = _NAME.fullmatch(line)
            if found is not None and found["value"][1:-1] == name:
                lines[number] = f'{found["key"]}"{other}"{found["rest"]}'
                break
        return "".join(lines)

    text = "".join(renamed(part) if host == name else part for part, host in _parts(text, known))
    _write(path, text, [other if one == name else one for one in known])
    return True


def _names(text: str, path: Path) -> dict[str, str]:
    """Address of each host by its name, in the order of the file."""
    return {host.name: host.address for host in parse_hosts(text, path)} if text.strip() else {}


def _parts(text: str, hosts: list[str]) -> Iterator[tuple[str, str]]:
    """The text in parts, each with the name of its host, or "" for text outside the entries."""
    number, part, host = -1, "", ""
    for line in text.splitlines(keepends=True):
        header = _HEADER.fullmatch(line)
        # `[hosts.node]` belongs to the entry above it, any other table ends the entry
        if header is not None and not header["name"].startswith("hosts."):
            yield part, host
            part = ""
            if header["name"] == "hosts":
                number += 1
            host = hosts[number] if header["name"] == "hosts" and number < len(hosts) else ""
        part += line
    yield part, host


def _write(path: Path, text: str, expected: list[str]) -> None:
    """Replaces the file if the new text has exactly the expected hosts.

    Raises: InvalidInput for other hosts; ConfigError, OSError.
    """
    # the edit was textual, so only parsing shows whether it did what it should
    if list(_names(text, path)) != expected:
        raise InvalidInput(
            f"{path}: its hosts are not tables `[[hosts]]`; expected that, or a change by hand"
        )
    replace_file(path, text.encode(), mode=MODE)
