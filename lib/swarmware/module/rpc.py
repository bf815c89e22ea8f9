"""Requests: the server runs handlers and converts their errors to replies."""

import inspect
import logging
from collections.abc import Awaitable, Callable
from typing import Any, Final

import msgspec

from swarmware.errors import KINDS, SwarmError
from swarmware.model.frame import Frame
from swarmware.module.accepted import Accepted
from swarmware.module.meta import Meta
from swarmware.types import registry
from swarmware.types.rpc import Reply

IN_WORK_LIMIT: Final = 64
"""Maximum concurrent requests of one path; more are refused."""

Handler = Callable[[Any, Meta], Awaitable[msgspec.Struct] | msgspec.Struct]
"""Handler: gets the request and its metadata; returns the reply, or raises a SwarmError for the caller."""
Start = Callable[[Any, str], object]
"""Function that runs a coroutine as a named task."""

log = logging.getLogger("swarm.rpc")


class Server:
    """Serves the requests of one path."""

    def __init__(
        self,
        path: str,
        cls: type[msgspec.Struct],
        handler: Handler,
        start: Start,
        accepted: Accepted | None = None,
    ) -> None:
        self.path = path
        self._cls = cls
        self._handler = handler
        self._start = start
        self._accepted = accepted
        self._in_work = 0

    def on_request(self, frame: Frame, respond: Callable[[Reply], None]) -> None:
        """Take a received request, from the router."""
        # refused at once: a waiting caller would repeat its request and add to the load
        if self._in_work >= IN_WORK_LIMIT:
            respond(Reply(False, kind="NoAnswer", error=f"{self.path}: {IN_WORK_LIMIT} requests in work"))
            return
        try:
            request = registry.decode(self._cls, frame.payload, frame.codec)
            if self._accepted is not None:
                self._accepted.take(frame)
            result = self._handler(request, Meta.of(frame))
        except Exception as error:  # noqa: BLE001 - the RPC server: every error of a handler is a reply to its caller
            respond(self._failed(error))
            return
        # most handlers answer at once, and need no task
        if inspect.isawaitable(result):
            self._in_work += 1
            self._start(self._finish(result, respond), f"serve {self.path}")
        else:
            respond(Reply(True, registry.encode(result)))

    async def _finish(self, result: Awaitable[msgspec.Struct], respond: Callable[[Reply], None]) -> None:
        # sent by `finally` if the handler is cancelled
        answer = Reply(False, kind="NoAnswer", error=f"{self.path}: the application ends")
        try:
            answer = Reply(True, registry.encode(await result))
        except Exception as error:  # noqa: BLE001 - the RPC server: every error of a handler is a reply to its caller
            answer = self._failed(error)
        finally:
            self._in_work -= 1
            respond(answer)

    def _failed(self, error: Exception) -> Reply:
        if isinstance(error, SwarmError):
            # a subclass of an application is unknown to the caller: its nearest known base is sent
            kind = next(cls.__name__ for cls in type(error).__mro__ if cls.__name__ in KINDS)
            return Reply(False, kind=kind, error=str(error))
        log.error("request %s: the handler failed", self.path, exc_info=error)
        return Reply(False, kind="SwarmError", error=f"{self.path}: {type(error).__name__}: {error}")
