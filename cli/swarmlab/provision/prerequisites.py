"""Prerequisites of a lab: modules of the extra `lab`, shared memory, and a database that answers."""

import os
from importlib import import_module
from pathlib import Path
from typing import Final

from swarmctl.terminal.output import Output
from swarmware.errors import SwarmError, missing_extra

REPORT: Final = ("numpy", "matplotlib")
PATIENCE_S: Final = 2.0
"""Time-out of the check: a server on the same network answers within milliseconds."""

NODE_BYTES: Final = 8_000_000
"""Shared memory of a node: 4.0 to 6.3 MB in a lab of four (`du -s /dev/shm/*`), more with more nodes."""


def check_shared_memory(folder: Path, nodes: int) -> None:
    """Raises: SwarmError if the file system has no room for the rings of all nodes.

    A container often has 64 MB; nodes that find it full start again and again.
    """
    found = os.statvfs(folder)
    free, total, needed = found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize, nodes * NODE_BYTES
    if free < needed:
        raise SwarmError(
            f"shared memory is too small: {folder}, {total - free} of {total} bytes are used;"
            f" expected {needed} bytes free for {nodes} nodes (a larger tmpfs: `docker run --shm-size`)"
        )


def require_modules(what: str, modules: tuple[str, ...]) -> None:
    """Check the modules that a command needs. Raises: ConfigError naming the extra when one is missing."""
    for module in modules:
        try:
            import_module(module)
        except ImportError as error:
            raise missing_extra(what, error, "lab") from error


def check_database(uri: str, out: Output) -> None:
    """Warns when the server does not answer: the nodes store their logs, and forward them later.

    Raises: ConfigError for an invalid address.
    """
    if not uri:
        return
    from swarmware.recorder.mongo import MongoStore, check_uri

    # an invalid address never answers, so it is an error and not a warning
    check_uri(uri)
    store = MongoStore(uri, timeout_s=PATIENCE_S, answer_s=PATIENCE_S)
    try:
        store.ping()
    except SwarmError as error:
        out.warn(f"{error}; the logs stay on the nodes until it answers")
    finally:
        store.close()
