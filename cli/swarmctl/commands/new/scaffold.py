"""Scaffolds: folders of share/swarm/scaffolds, copied under a name of the user's choice."""

import keyword
import re
import shlex
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.terminal.output import Output
from swarmware.errors import Conflict, InvalidInput, NotFound
from swarmware.footprint.entry_points import (
    BLOCK_GROUP,
    DRIVER_GROUP,
    OWN_DRIVERS,
    SERVICE_GROUP,
    entry_points,
)
from swarmware.mission.installed import installed
from swarmware.model.config import share_dir
from swarmware.runtime.filewriter import naming

NAME: Final = "my_name"
"""Stands for the new name in the paths and texts of a scaffold, which so are valid Python."""
CLASS_NAME: Final = "MyName"
"""Stands for the name of its class."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}\Z")
_CACHE: Final = "__pycache__"


class ScaffoldKind(msgspec.Struct, frozen=True):
    """What can be made, and which names it may have."""

    example: str
    """A name for the message that refuses another."""
    test: str = "python -m pytest"
    """Command that tests the result, in its folder."""
    imported: bool = True
    """Whether a Python module gets the name."""
    group: str = ""
    """Group of its entry point."""


KINDS: Final[dict[str, ScaffoldKind]] = {
    "module": ScaffoldKind("thermometer"),
    "driver": ScaffoldKind("sonar", group=DRIVER_GROUP),
    "service": ScaffoldKind("lookout", group=SERVICE_GROUP),
    "block": ScaffoldKind("survey", group=BLOCK_GROUP),
    "mission": ScaffoldKind("relay", test="swarmctl mission check .", imported=False),
}
"""By the name of their folder in share/swarm/scaffolds, which equals the name of their command."""


class NewFolder(msgspec.Struct, frozen=True):
    """A folder that was made from a scaffold."""

    kind: str
    """module | driver | service | block | mission"""
    name: str
    path: str
    """The new folder."""
    files: tuple[str, ...]
    """Paths below it."""
    test: str
    """Shell command that tests it."""


def make_scaffold(kind: str, name: str, parent: Path, out: Output) -> None:
    """Make the folder `parent/name` from the scaffold of a kind.

    Raises: InvalidInput for an invalid name, Conflict for a taken one, NotFound without the parent.
    """
    made = KINDS[kind]
    _check_name(kind, name)
    if not parent.is_dir():
        raise NotFound(f"folder {parent}: not found; expected one in which {name} is made")
    folder = parent / name
    # `exists` is false for a link without a target, through which the folder would be made elsewhere
    if folder.exists() or folder.is_symlink():
        raise Conflict(f"{folder}: exists; expected a new name, or another folder with --dir")
    _check_free(kind, name)
    files = rendered(share_dir() / "scaffolds" / kind, name)
    write_files(folder, files)
    test = f"cd {shlex.quote(str(folder))} && {made.test}"
    if out.settings.structured:
        out.document(NewFolder(kind, name, str(folder.resolve()), tuple(files), test))
        return
    for path in files:
        out.verbatim(str(folder / path))
    out.say(f"test it: {test}")


def _check_name(kind: str, name: str) -> None:
    if not _NAME.match(name):
        raise InvalidInput(
            f"name {name!r} of a {kind}: expected [a-z][a-z0-9_]{{0,30}}, such as {KINDS[kind].example}"
        )
    if KINDS[kind].imported and keyword.iskeyword(name):
        raise InvalidInput(f"name {name!r} of a {kind}: a word of Python; expected another name")


def _check_free(kind: str, name: str) -> None:
    """Raises: Conflict when the name belongs to a plug-in or to a Python module that is installed."""
    group = KINDS[kind].group
    owners = {point.name: point.value for point in entry_points(group)} if group else {}
    if group == DRIVER_GROUP:
        owners |= dict.fromkeys(OWN_DRIVERS, "swarmware")
    if group == BLOCK_GROUP and _class_name(name) in installed().types:
        raise Conflict(f"name {name!r}: a block type {_class_name(name)} is installed; expected another name")
    if name in owners:
        raise Conflict(f"name {name!r}: the {kind} of {owners[name]} has it; expected another name")
    if KINDS[kind].imported and (spec := find_spec(name)) is not None and spec.origin is not None:
        raise Conflict(f"name {name!r}: the Python module {spec.origin} has it; expected another name")


def rendered(scaffold: Path, name: str) -> dict[str, str]:
    """Texts of the files of a scaffold under a new name, by their paths.

    Raises: NotFound when this installation does not have the scaffold.
    """
    sources = [path for path in sorted(scaffold.rglob("*")) if path.is_file() and _CACHE not in path.parts]
    if not sources:
        raise NotFound(f"scaffold {scaffold}: not found; expected it in this installation")
    files = {
        _renamed(str(path.relative_to(scaffold)), name): _renamed(path.read_text("utf-8"), name)
        for path in sources
    }
    return dict(sorted(files.items()))


def _renamed(text: str, name: str) -> str:
    return text.replace(NAME, name).replace(CLASS_NAME, _class_name(name))


def _class_name(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def write_files(folder: Path, files: dict[str, str]) -> None:
    """Make a new folder with these files, or leave nothing.

    Raises: OSError.
    """
    folder.mkdir()
    try:
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            with naming(folder / path):
                (folder / path).write_text(text, "utf-8")
    except BaseException:
        shutil.rmtree(folder)
        raise
