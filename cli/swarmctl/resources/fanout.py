"""Requests to many platforms concurrently."""

import asyncio
from typing import TypeVar

import msgspec

from swarmctl.resources.newest import newest
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.types import registry

R = TypeVar("R", bound=msgspec.Struct)


async def ask_all(
    session: Session, asked: list[str], path: str, value: msgspec.Struct, reply: type[R]
) -> tuple[dict[str, R], dict[str, SwarmError]]:
    """The answers, and the errors of the platforms without an answer."""

    async def one(platform: str) -> R | SwarmError:
        try:
            return await session.ask(names.join(platform, path), value, reply)
        except SwarmError as error:
            return error

    return _sorted_out(asked, await asyncio.gather(*(one(platform) for platform in asked)))


async def read_boards(
    session: Session, asked: list[str], path: str, cls: type[R], *, fresh: bool = False
) -> tuple[dict[str, R], dict[str, SwarmError]]:
    """The newest value of a board of each platform: from a mirror if there is one, else from its owner.

    `fresh`: ask the owner at once, for boards without a subscriber, which have no mirror. A platform
    without a route gets an error; `last_values` has its last values.
    """

    async def one(platform: str) -> R | SwarmError:
        try:
            # without a route the owner cannot answer, and a mirror here would pass for its present state
            await session.reach(platform)
            return registry.decode(cls, (await newest(session, names.join(platform, path), fresh=fresh)).data)
        except SwarmError as error:
            return error

    return _sorted_out(asked, await asyncio.gather(*(one(platform) for platform in asked)))


def _sorted_out(asked: list[str], found: list[R | SwarmError]) -> tuple[dict[str, R], dict[str, SwarmError]]:
    answers: dict[str, R] = {}
    errors: dict[str, SwarmError] = {}
    for platform, answer in zip(asked, found, strict=True):
        if isinstance(answer, SwarmError):
            errors[platform] = answer
        else:
            answers[platform] = answer
    return answers, errors


def warn_errors(session: Session, errors: dict[str, SwarmError]) -> None:
    """Prints a warning for each platform that did not answer."""
    for error in errors.values():
        session.out.warn(str(error))
