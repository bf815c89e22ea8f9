"""Modules that the libraries of a command import and hardly use: they are loaded at their first use.

With `inspect` come the modules of the compiler, with `uuid` the name of the operating system. Together
they took a seventh of the processor time of `swarmctl --help`.
"""

import os
import sys
import typing
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Final

_COROUTINE: Final = 0x80
"""CO_COROUTINE of `inspect`: flag of the code of an `async def`."""


def cleandoc(doc: str) -> str:
    """The docstring without its indentation and outer empty lines, as from `inspect.cleandoc`."""
    first, *others = doc.expandtabs().split("\n")
    margin = min((len(line) - len(line.lstrip()) for line in others if line.lstrip()), default=0)
    lines = [first.lstrip(), *(line[margin:] for line in others)]
    while lines and not lines[-1]:
        lines.pop()
    while lines and not lines[0]:
        del lines[0]
    return "\n".join(lines)


def isfunction(value: object) -> bool:
    """Whether the value is a function written in Python, as from `inspect.isfunction`."""
    return isinstance(value, FunctionType)


def iscoroutinefunction(value: object) -> bool:
    """Whether a call of the value makes a coroutine, as from `inspect.iscoroutinefunction`."""
    while isinstance(value, (MethodType, partial)):
        value = value.__func__ if isinstance(value, MethodType) else value.func
    code = getattr(value, "__code__", None)
    return isinstance(code, CodeType) and bool(code.co_flags & _COROUTINE)


def unwrap(value: object, *, stop: Callable[[object], object] | None = None) -> object:
    """The function within its decorators, as from `inspect.unwrap`."""
    seen: set[int] = set()
    while hasattr(value, "__wrapped__") and id(value) not in seen and not (stop and stop(value)):
        seen.add(id(value))
        value = value.__wrapped__
    return value


def system() -> str:
    """Name of the operating system, as from `platform.system`."""
    return os.uname().sysname


class LateModule(ModuleType):
    """Stands for a module until a name is used that not every command uses."""

    def __getattr__(self, name: str) -> object:
        # the import system looks up such names in any module, which must not load this one
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules.get(self.__name__) is self:
            # removed first, or the import below would find this stand-in
            del sys.modules[self.__name__]
        return getattr(import_module(self.__name__), name)


class _Uuid:
    """Stands in the base of a class of click; a value needs the real `uuid.UUID`."""


USED: Final[dict[str, dict[str, object]]] = {
    "inspect": {one.__name__: one for one in (cleandoc, isfunction, iscoroutinefunction, unwrap)},
    "platform": {"system": system},
    "uuid": {"UUID": _Uuid},
    "ipaddress": {},
    "typing_extensions": {
        name: getattr(typing, name) for name in ("get_type_hints", "NotRequired", "Required")
    },
}
"""Names that click, asyncio, `uuid` and msgspec use in every command, by module. Without `typing_extensions`
msgspec takes the same ones of `typing`."""


@contextmanager
def late_modules() -> Iterator[None]:
    """Context manager for the import of click: modules of USED that are not loaded wait for a first use."""
    late = {name: LateModule(name) for name in USED if name not in sys.modules}
    for name, module in late.items():
        vars(module).update(USED[name])
    sys.modules.update(late)
    try:
        yield
    finally:
        if "uuid" in late:
            # click has its base class by now; a later use needs the real class
            del vars(late["uuid"])["UUID"]
