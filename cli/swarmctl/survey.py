"""One question to every platform of the swarm at once."""

import asyncio
from typing import TypeVar

import msgspec

from swarmctl.connect import Link
from swarmware import names
from swarmware.errors import SwarmError
from swarmware.types.net import Routes
from swarmware.types.rpc import Empty

R = TypeVar("R", bound=msgspec.Struct)


async def platforms(link: Link) -> list[str]:
    """The node that was joined and every platform it can reach.

    Raises: NoAnswer when its broker does not answer.
    """
    routes = await link.ask(f"/{link.here}/sys/broker/routes", Empty(), Routes)
    return sorted({link.here, *(route.platform for route in routes.routes)}, key=names.natural)


async def ask_all(
    link: Link, asked: list[str], path: str, value: msgspec.Struct, reply: type[R]
) -> tuple[dict[str, R], dict[str, SwarmError]]:
    """The answers, and the errors of those that gave none."""

    async def one(platform: str) -> R | SwarmError:
        try:
            return await link.ask(names.join(platform, path), value, reply)
        except SwarmError as error:
            return error

    found = await asyncio.gather(*(one(platform) for platform in asked))
    answers: dict[str, R] = {}
    errors: dict[str, SwarmError] = {}
    for platform, answer in zip(asked, found, strict=True):
        if isinstance(answer, SwarmError):
            errors[platform] = answer
        else:
            answers[platform] = answer
    return answers, errors


def complain(link: Link, errors: dict[str, SwarmError]) -> None:
    """Says on stderr who did not answer.

    Raises: the error itself when the only platform asked gave none.
    """
    for platform, error in errors.items():
        link.out.warn(f"{platform}: {error}")
