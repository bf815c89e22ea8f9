"""The contract of a core (ADR 22): a class with `on_timer` has all of it, and takes the daemon's settings."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import Final

import msgspec
import pytest

import swarmd
import swarmware
from swarmware.runtime.core import Core


def modules() -> Iterator[ModuleType]:
    """All modules of the daemons and of the library."""
    for package in (swarmd, swarmware):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not found.name.endswith("__main__"):
                yield importlib.import_module(found.name)


def classes() -> Iterator[type]:
    """The classes that these modules define."""
    for module in modules():
        for cls in vars(module).values():
            if inspect.isclass(cls) and cls.__module__ == module.__name__:
                yield cls


CORES: Final = [
    cls
    for cls in classes()
    if "on_timer" in vars(cls) and cls is not Core and not cls.__module__.endswith(".service")
]
"""All cores, without the shells: a shell that reads inputs before each deadline has `on_timer`, too."""


def methods(cls: type) -> dict[str, inspect.Signature]:
    """Public methods of a class, without properties."""
    return {
        name: inspect.signature(member)
        for name, member in vars(cls).items()
        if inspect.isfunction(member) and not name.startswith("_")
    }


def returned(signature: inspect.Signature) -> str:
    """What a method returns, as it is written."""
    kind = signature.return_annotation
    return kind if isinstance(kind, str) else inspect.formatannotation(kind)


def gives_actions(text: str) -> bool:
    """A list of actions, alone or beside the answer to a question."""
    if text.startswith("tuple["):
        return text.endswith("]]") and "list[" in text
    return text.startswith("list[")


def test_the_cores_of_all_daemons_are_found() -> None:
    daemons = {cls.__module__.split(".")[1] for cls in CORES if cls.__module__.startswith("swarmd.")}
    assert daemons >= {"broker", "guard", "health", "mission", "register", "sim", "timesync", "tree"}


@pytest.mark.parametrize("core", CORES, ids=lambda cls: str(cls.__name__))
def test_a_core_has_the_whole_contract(core: type) -> None:
    found = methods(core)
    assert list(found["on_timer"].parameters) == ["self", "now_ns"]
    assert "deadline_ns" in found, "it cannot say when it wants to be called"
    assert list(found["deadline_ns"].parameters) == ["self"]
    assert returned(found["deadline_ns"]) in {"int", "int | None"}
    assert not any(inspect.iscoroutinefunction(member) for member in vars(core).values())
    for name, signature in found.items():
        if name.startswith("on_"):
            assert list(signature.parameters)[-1] == "now_ns", f"{name}: expected now_ns as its last argument"
            assert gives_actions(returned(signature)), f"{name}: expected a list of actions"


@pytest.mark.parametrize(
    "core", [cls for cls in CORES if cls.__module__.startswith("swarmd.")], ids=lambda cls: str(cls.__name__)
)
def test_core_of_daemon_takes_its_frozen_config(core: type) -> None:
    daemon = core.__module__.split(".")[1]
    config = importlib.import_module(f"swarmd.{daemon}.config").Config
    assert issubclass(config, msgspec.Struct)
    assert config.__struct_config__.frozen
    taken = [parameter.annotation for parameter in inspect.signature(core).parameters.values()]
    assert config in taken, f"{core.__name__}: expected its settings as {daemon}.config.Config"
