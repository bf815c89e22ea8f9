"""The database that the logs of a lab go to: looked at before the lab starts."""

from typing import Final

from swarmctl.output import Output
from swarmware.errors import SwarmError

PATIENCE_S: Final = 2.0
"""A server on the same network answers within milliseconds."""


def examine(uri: str, out: Output) -> None:
    """Says when the server does not answer: the nodes keep their logs, and forward them when it does.

    Raises: ConfigError for an address that is none.
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
