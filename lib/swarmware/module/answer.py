"""The asking end of requests: waits for the reply, gives what it holds, raises the error that it names."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

import msgspec

from swarmware.errors import NotFound, TypeMismatch, from_kind
from swarmware.types import registry
from swarmware.types.rpc import Reply

R = TypeVar("R", bound=msgspec.Struct)


async def answer(path: str, comes: asyncio.Future[Reply], cls: type[R], mismatch: Callable[[], str]) -> R:
    """The answer to a request that has left.

    `mismatch` says why the address cannot take its type; empty when that is not the reason.
    Raises: the error of the handler as its own class; NoAnswer, NotFound, TypeMismatch.
    """
    try:
        reply = await comes
    except NotFound as error:
        if wrong := mismatch():
            raise TypeMismatch(wrong) from error
        raise NotFound(f"{path}: {error}") from error
    if not reply.ok:
        raise from_kind(reply.kind, reply.error)
    return registry.decode(cls, reply.body)
