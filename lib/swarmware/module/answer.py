"""The answer to a request that was sent: the reply, or the error of the handler raised again."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

import msgspec

from swarmware.errors import NotFound, TypeMismatch, from_kind
from swarmware.types import registry
from swarmware.types.rpc import Reply

R = TypeVar("R", bound=msgspec.Struct)


async def answer(path: str, comes: asyncio.Future[Reply], cls: type[R], mismatch: Callable[[], str]) -> R:
    """Wait for the reply to a request that was sent.

    `mismatch` returns why the address does not accept its type; empty: that is not the reason.
    Raises: the error of the handler as its own class; NoAnswer, NotFound, TypeMismatch.
    """
    try:
        reply = await comes
    except NotFound as error:
        if error_text := mismatch():
            raise TypeMismatch(error_text) from error
        raise NotFound(f"{path}: {error}") from error
    if not reply.ok:
        raise from_kind(reply.kind, reply.error)
    return registry.decode(cls, reply.body)
