"""Imports have one direction: no circles between the rooms of a package, no climb to a package above.

A room is a file or a folder directly in a package. Imports for type checking alone and imports in functions
count as well: whoever reads a room must know what it imports.
"""

from graphlib import TopologicalSorter
from typing import Final

import pytest
from tests.architecture.sources import ROOT, files, imports

CLIMBS: Final = {
    ("swarmware.types.registry", "swarmware.types"): "lists the files of the package, to import them",
}
"""Imports of a package by a module in it, each with its reason."""


PAIRS: Final = {"broker": 68, "tree": 45}
"""Maximum pairs of rooms of a daemon and of its core, one importing the other; the broker had 136."""
TOP: Final = 10
ENTRIES: Final = 8
"""Maximum entries of a daemon and of its core, and of each other folder in it."""
PACKAGES: Final = [name for name, path in files().items() if path.name == "__init__.py"]


def rooms(package: str) -> dict[str, set[str]]:
    """The rooms of a package, and the other rooms that each imports."""
    start = f"{package}."
    arrows: dict[str, set[str]] = {}
    for name, targets in imports().items():
        if name.startswith(start):
            room = name.removeprefix(start).partition(".")[0]
            others = {one.removeprefix(start).partition(".")[0] for one in targets if one.startswith(start)}
            arrows.setdefault(room, set()).update(others - {room})
    return arrows


@pytest.mark.parametrize("package", PACKAGES)
def test_rooms_of_a_package_import_in_one_direction(package: str) -> None:
    TopologicalSorter(rooms(package)).prepare()  # raises CycleError with the rooms of a circle


def test_no_module_imports_a_package_above_it() -> None:
    found = {
        (name, target)
        for name, targets in imports().items()
        for target in targets
        if name.startswith(f"{target}.") and target in PACKAGES
    }
    assert found == set(CLIMBS), "move what is imported below both, or give a reason"


def pairs(daemon: str) -> set[frozenset[str]]:
    """Pairs of rooms: of entries of the daemon and of its core of which one imports the other."""
    start = f"swarmd.{daemon}."

    def room(module: str) -> str:
        words = module.removeprefix(start).split(".")
        return ".".join(words[: 2 if words[0] == "core" else 1])

    return {
        frozenset({room(name), room(target)})
        for name, targets in imports().items()
        for target in targets
        if name.startswith(start) and target.startswith(start) and room(name) != room(target)
    }


@pytest.mark.parametrize("daemon", PAIRS)
def test_daemon_has_few_rooms_that_know_each_other(daemon: str) -> None:
    assert len(pairs(daemon)) <= PAIRS[daemon]
    home = ROOT / "daemons/swarmd" / daemon
    crowded = {
        str(folder.relative_to(home)): count
        for folder in (home, *(path for path in home.rglob("*") if path.is_dir()))
        if (count := sum(not path.name.startswith("__") for path in folder.iterdir()))
        > (TOP if folder in {home, home / "core"} else ENTRIES)
    }
    assert crowded == {}
