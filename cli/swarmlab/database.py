"""Checks the database for the logs of a lab before the lab starts."""

from typing import Final

from swarmctl.output import Output
from swarmware.errors import SwarmError

PATIENCE_S: Final = 2.0
"""Time-out of the check: a server on the same network answers within milliseconds."""


def examine(uri: str, out: Output) -> None:
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
