"""Detects leaks of a test: processes, descriptors, shared memory, threads."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOCKS = {"boot", "master.lock"}
"""Files that persist: they contain the numbers of the node's last start and of its last master."""
KEPT = frozenset({"etc", "missions"})
"""Folders whose files persist: the configuration of a node, and its missions with their runs."""
FORK_SERVERS: set[int] = set()
"""Processes that fork for this one: their child processes count as its own."""


@contextmanager
def no_leaks(*folders: Path) -> Iterator[None]:
    """Raises AssertionError if the block leaves a child process, a thread, an open descriptor, something
    in shared memory, or a file in a folder (a node's configuration, its two lock files and the records of its
    runs may stay)."""
    before = _state()
    yield
    left = {what: after - before[what] for what, after in _state().items()}
    for folder in folders:
        left["files"] = left.get("files", set()) | {
            str(path)
            for path in folder.rglob("*")
            if not path.is_dir() and path.name not in LOCKS and not KEPT & set(path.parts)
        }
    found = {what: sorted(names) for what, names in left.items() if names}
    assert not found, f"left behind: {found}"


def _state() -> dict[str, set[str]]:
    return {
        "children": {str(pid) for parent in (os.getpid(), *FORK_SERVERS) for pid in children(parent)},
        # asyncio's thread that waited for a child ends a moment after the child
        "threads": {t.name for t in threading.enumerate() if not t.name.startswith("asyncio-waitpid")},
        "descriptors": set(_descriptors()),
    }


def children(pid: int) -> set[int]:
    """Child processes of a process; an ended process has none."""
    found: set[int] = set()
    with suppress(FileNotFoundError):  # a process or thread that ended a moment ago
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(FileNotFoundError, ProcessLookupError):
                found |= {int(child) for child in (task / "children").read_text().split()}
    return found


def _descriptors() -> Iterator[str]:
    for link in Path("/proc/self/fd").iterdir():
        try:
            target = str(link.readlink())
        except FileNotFoundError:
            continue  # the descriptor of this listing
        if not target.startswith(("/proc", "pipe:", "/dev/pts")):
            yield target
