"""Names in requests lead to no file outside the folders of the node, whatever a partner puts into them."""

import asyncio
import ctypes
import os
import types
import typing
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import msgspec
from tests.patience import PATIENCE_S

from swarmware.errors import SwarmError
from swarmware.model.resource import Kind
from swarmware.module.module import Module
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types import registry
from swarmware.types.tree import TreeList, TreeListing

SERVICES: Final = (
    *("broker", "tree", "register", "timesync", "health", "guard", "mission", "logger"),
    *("hal", "sim", "control", "navigator", "files"),
)
SECRET: Final = "secret-7731.txt"
SIZE_BYTES: Final = 7_731_773
"""Of a file that no request may tell of: a number that occurs in no other answer."""
_OPENED: Final = 0x20
"""IN_OPEN of sys/inotify.h."""


def names(target: Path, folder: Path) -> list[str]:
    """Names that lead from a folder of the node to the file."""
    upwards = os.path.relpath(target, folder)
    return [str(target), upwards, f"x/../{upwards}", f"/{upwards}", f"./{upwards}"]


def hostile(kind: Any, text: str) -> Any:
    """A value of this type with this text wherever it takes one."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return hostile(arguments[0], text)
    if origin in {types.UnionType, typing.Union}:
        return hostile(str if str in arguments else arguments[0], text)
    if origin is tuple:
        return tuple(hostile(one, text) for one in arguments if one is not ...)
    if origin is dict:
        return {hostile(arguments[0], text): hostile(arguments[1], text)}
    if origin is typing.Literal:
        return arguments[0]
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        hints = typing.get_type_hints(kind, include_extras=True)
        return kind(**{name: hostile(hints[name], text) for name in kind.__struct_fields__})
    if kind is str:
        return text
    if kind is bytes:
        return bytes(32)
    if isinstance(kind, type) and hasattr(kind, "__members__"):
        return next(iter(kind))  # type: ignore[call-overload]  # an enumeration
    return kind() if kind in {int, float, bool} else text


@contextmanager
def opened(paths: list[Path]) -> Iterator[list[int]]:
    """The number of openings of these files by any process, when the block has ended."""
    libc = ctypes.CDLL(None, use_errno=True)
    watch = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
    found: list[int] = []
    try:
        for path in paths:
            assert libc.inotify_add_watch(watch, os.fsencode(path), _OPENED) >= 0
        yield found
        try:
            found.append(len(os.read(watch, 4096)))
        except BlockingIOError:
            found.append(0)
    finally:
        os.close(watch)


async def test_request_reads_no_file_outside_nodes_folders(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={name: {} for name in SERVICES})
    outside = [tmp_path / SECRET, config / SECRET]
    for path in outside:
        with path.open("wb") as file:
            file.truncate(SIZE_BYTES)
    folders = [tmp_path / f"uav1/data/{name}" for name in ("files", "missions/x", "log")]
    texts = sorted({one for path in outside for folder in folders for one in names(path, folder)})
    asked = told = 0
    async with spawn(config, ready_s=PATIENCE_S), Module("partner", config_dir=config) as module:
        commands = await _commands(module)
        with opened(outside) as openings:
            for command, (request, reply) in commands.items():
                for text in texts:
                    asked += 1
                    try:
                        answer = await module.request(
                            command, hostile(request, text), reply, timeout_s=PATIENCE_S
                        )
                    except SwarmError as error:
                        told += str(SIZE_BYTES) in str(error)
                    else:
                        told += str(SIZE_BYTES) in str(msgspec.to_builtins(answer))
    assert asked > 100
    assert told == 0
    assert openings == [0]


async def _commands(module: Module) -> dict[str, tuple[type[msgspec.Struct], type[msgspec.Struct]]]:
    """Types of request and answer of each command that takes a text, when every service has its commands."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with suppress(SwarmError):
                listing = await module.request("sys/tree/list", TreeList("**"), TreeListing)
                found = {one.path: one for one in listing.entries if one.kind is Kind.COMMAND and one.reply}
                if any("sys/files/" in path for path in found):
                    types = {
                        path: (registry.find(one.type), registry.find(one.reply))
                        for path, one in found.items()
                    }
                    return {
                        path: pair
                        for path, pair in types.items()
                        if hostile(pair[0], "a") != hostile(pair[0], "b")
                    }
            await asyncio.sleep(0.1)
