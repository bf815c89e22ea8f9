"""Orders of an operator to the radio of a lab, and their way: one request for each connection."""

import asyncio
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

import msgspec

from swarmlab.radio.core.link import ImpairmentChange
from swarmlab.radio.core.network import LinkReport
from swarmware.errors import NoAnswer, SwarmError

SOCKET: Final = "radio.sock"
"""Name of the radio's socket in the folder of the lab."""
ANSWER_S: Final = 5.0
ORDER_BYTES: Final = 1 << 22
"""Maximum length of an order: all links of 200 nodes by their names."""

Links = tuple[tuple[str, str], ...]
"""Directions of links: sender and receiver, as names of nodes."""


class ReadLinks(msgspec.Struct, frozen=True, tag="read"):
    """Report the state of these directions."""

    links: Links


class ImpairLinks(msgspec.Struct, frozen=True, tag="impair"):
    """Change the impairment of these directions."""

    links: Links
    change: ImpairmentChange


class CutLinks(msgspec.Struct, frozen=True, tag="cut"):
    """Stop all frames in these directions."""

    links: Links


class HealLinks(msgspec.Struct, frozen=True, tag="heal"):
    """Remove cuts and impairments of these directions."""

    links: Links


RadioOrder = ReadLinks | ImpairLinks | CutLinks | HealLinks


class RadioAnswer(msgspec.Struct, frozen=True):
    """State of the directions that an order names, or why it was refused."""

    links: list[LinkReport] = []
    refusal: str = ""


def send(folder: Path, order: RadioOrder) -> list[LinkReport]:
    """Sends an order to the radio of the lab in this folder; the state of its links afterwards.

    Raises: NoAnswer when no radio runs there, SwarmError when it refuses.
    """
    path = folder / SOCKET
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(ANSWER_S)
            connection.connect(str(path))
            connection.sendall(msgspec.json.encode(order) + b"\n")
            with connection.makefile("rb") as file:
                answer = msgspec.json.decode(file.read(), type=RadioAnswer)
    except (OSError, msgspec.DecodeError) as error:
        raise NoAnswer(f"radio of the lab ({path}): {error}; expected its process to run") from error
    if answer.refusal:
        raise SwarmError(f"radio of the lab: {answer.refusal}")
    return answer.links


class OrderServer:
    """Answers orders on a Unix socket in the lab's folder."""

    def __init__(self, folder: Path, execute: Callable[[RadioOrder], list[LinkReport]]) -> None:
        """`execute`: KeyError for the name of a node that does not exist."""
        self._path = folder / SOCKET
        self._execute = execute
        self._server: asyncio.Server | None = None

    async def __aenter__(self) -> Self:
        self._unlink()
        self._server = await asyncio.start_unix_server(self._serve, self._path, limit=ORDER_BYTES)
        return self

    async def __aexit__(self, *error: object) -> None:
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
        self._unlink()

    def _unlink(self) -> None:
        self._path.unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            writer.write(msgspec.json.encode(self._answer(await reader.readline())))
            await writer.drain()
        except (OSError, ValueError):
            pass  # the client has closed, or its order is too long: it gets no answer
        finally:
            writer.close()

    def _answer(self, data: bytes) -> RadioAnswer:
        try:
            order = msgspec.json.decode(data, type=RadioOrder)
            return RadioAnswer(self._execute(order))
        except msgspec.DecodeError as error:
            return RadioAnswer(refusal=f"{error}; expected an order")
        except KeyError as error:
            return RadioAnswer(refusal=f"node {error}: no such node")
