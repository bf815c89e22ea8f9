"""Prerequisites of a lab: modules of the extra `lab`, and a database for its logs that answers."""

from importlib import import_module
from typing import Final

from swarmctl.terminal.output import Output
from swarmware.errors import SwarmError, missing_extra

REPORT: Final = ("numpy", "matplotlib")
PATIENCE_S: Final = 2.0
"""Time-out of the check: a server on the same network answers within milliseconds."""


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

    check_uri(uri)
    store = MongoStore(uri, timeout_s=PATIENCE_S, answer_s=PATIENCE_S)
    try:
        store.ping()
    except SwarmError as error:
        out.warn(f"{error}; the logs stay on the nodes until it answers")
    finally:
        store.close()
