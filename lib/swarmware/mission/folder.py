"""A mission of an ensemble: a manifest (mission.toml) that assigns files to roles, and the files."""

import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Final

import msgspec

from swarmware.errors import ConfigError, InvalidInput, NotFound
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import Catalogue, Name, built_in
from swarmware.mission.model import content_hash
from swarmware.mission.source import SourceError
from swarmware.mission.source import parse as parse_source
from swarmware.model import document
from swarmware.model.config import parse as parse_toml
from swarmware.model.platform_kind import VEHICLES, PlatformKind
from swarmware.types.mission import MissionFile, ParamValue

MANIFEST: Final = "mission.toml"
FILE_LIMIT: Final = 64
"""Maximum number of files of one mission."""

FileName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$")]


class Series(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A parameter that differs for each platform of a role: first, first + step, …"""

    first: int | float
    step: int | float

    def at(self, index: int) -> float:
        """Value of the role's index-th platform, from 0."""
        return self.first + self.step * index


class RoleSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One role in the manifest."""

    name: Name
    file: FileName
    """Name of the role's BDL file."""
    kinds: tuple[PlatformKind, ...]
    """Kinds of platform that can have the role."""
    take: Annotated[int, msgspec.Meta(ge=0, le=1_000)] = 0
    """Number of platforms with the role; 0: all remaining ones of these kinds."""
    required: bool = True
    """The mission does not start without a platform for this role."""
    params: dict[str, ParamValue | Series] = {}
    """Values that replace the defaults in the file."""

    def __post_init__(self) -> None:
        """Check that the kinds are known."""
        if not self.kinds or not all(kind.known for kind in self.kinds):
            raise InvalidInput(f"kinds of role {self.name!r}: expected some of {', '.join(PlatformKind)}")


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contents of a mission folder's `mission.toml`."""

    name: Name
    title: str = ""
    roles: tuple[RoleSpec, ...]
    """Roles are assigned in this order, to platforms in natural order of their names (uav2 before uav10)."""
    params: dict[str, ParamValue] = {}
    """Parameters of all roles; a text `$role.<name>` means the first platform with that role."""

    def __post_init__(self) -> None:
        """Check that there are roles, and that their names are unique."""
        names = [role.name for role in self.roles]
        if not names or len(set(names)) != len(names):
            raise InvalidInput("roles: expected at least one, with unique names")


class Folder(msgspec.Struct, frozen=True):
    """A mission with the contents of all its files."""

    where: str
    """Origin for error messages: a path, or the name of the sender."""
    manifest: Manifest
    texts: dict[str, str]
    """Contents of the roles' files, by name."""
    hash: str
    """BLAKE2b-128 of names and contents, hex."""

    def place(self, file: str) -> str:
        """Name of a file in findings."""
        return f"{self.where}/{file}" if self.where else file

    def param_names(self) -> set[str]:
        """Names of all parameters in the manifest."""
        return set(self.manifest.params).union(*(role.params for role in self.manifest.roles))

    def example(self, role: RoleSpec) -> Binding:
        """The binding of the role's first platform, for checks."""
        first = {other.name: f"{other.kinds[0]}1" for other in self.manifest.roles}
        params = {**self.manifest.params, **self.role_params(role, 0)}
        return Binding(
            first[role.name], role.kinds[0], role.name, self.manifest.name, name_roles(params, first)
        )

    @staticmethod
    def role_params(role: RoleSpec, index: int) -> dict[str, ParamValue]:
        """The parameters of the role for its index-th platform."""
        return {
            name: value.at(index) if isinstance(value, Series) else value
            for name, value in role.params.items()
        }


def name_roles(params: dict[str, ParamValue], first: dict[str, str]) -> dict[str, ParamValue]:
    """The parameters with `$role.<name>` replaced by the first platform with that role."""
    return {
        name: first.get(value.removeprefix("$role."), value)
        if isinstance(value, str) and value.startswith("$role.")
        else value
        for name, value in params.items()
    }


def files_hash(files: Iterable[MissionFile]) -> str:
    """The hash of a mission with these files, independent of their order."""
    named = sorted((file.name, file.text) for file in files)
    return content_hash(*(part for pair in named for part in pair))


def read_files(path: Path) -> list[MissionFile]:
    """The files of the mission at this path: of a folder or manifest, or a single BDL file.

    Other files in the folder are ignored.
    Raises: NotFound when the path does not exist; ConfigError when a file cannot be read.
    """
    if path.is_file() and path.name != MANIFEST:
        return [MissionFile(path.name, document.read(path))]
    folder = path if path.is_dir() else path.parent
    if not (folder / MANIFEST).is_file():
        raise NotFound(f"{path}: no {MANIFEST} in it; expected a mission folder, or a BDL file")
    text = document.read(folder / MANIFEST)
    manifest = parse_toml(text, Manifest, str(folder / MANIFEST))
    names = sorted({role.file for role in manifest.roles})
    # `from_files` reports a missing one
    there = [folder / name for name in names if (folder / name).is_file()]
    return [MissionFile(MANIFEST, text), *(MissionFile(file.name, document.read(file)) for file in there)]


def read_folder(path: Path, catalogue: Catalogue | None = None) -> Folder:
    """The mission at this path: a folder with a mission.toml, or one BDL file.

    Raises: NotFound when the path does not exist; ConfigError when it is invalid or a file is missing.
    """
    files = read_files(path)
    where = path.parent if path.is_file() else path
    return from_files(files, "" if where == Path() else str(where), catalogue)


def from_files(
    files: list[MissionFile] | tuple[MissionFile, ...], where: str, catalogue: Catalogue | None = None
) -> Folder:
    """The mission of these files; a single BDL file is for all vehicles that can execute all its blocks.

    Raises: ConfigError when the manifest is invalid or names a missing file.
    """
    if not 1 <= len(files) <= FILE_LIMIT:
        raise ConfigError(f"{where}: {len(files)} files; expected 1 to {FILE_LIMIT}")
    for file in files:
        try:
            (file.name + file.text).encode()
        except UnicodeEncodeError as error:
            raise ConfigError(f"{where}: file {file.name!r}: {error.reason}; expected UTF-8") from error
    texts = {file.name: file.text for file in files}
    if len(texts) != len(files):
        raise ConfigError(f"{where}: two files of one name; expected each once")
    digest = files_hash(files)
    source = f"{where}/{MANIFEST}" if where else MANIFEST
    if MANIFEST in texts:
        manifest = parse_toml(texts.pop(MANIFEST), Manifest, source)
    elif len(texts) == 1:
        ((name, text),) = texts.items()
        kinds, params = _able(text, name, catalogue or built_in())
        role = RoleSpec(name="all", file=name, kinds=kinds)
        manifest = Manifest(name=name.removesuffix(".json")[:64] or "mission", roles=(role,), params=params)
    else:
        raise ConfigError(f"{where}: {len(files)} files without {MANIFEST}; expected it, or a single file")
    used = {role.file for role in manifest.roles}
    for name in sorted(used - texts.keys()):
        raise ConfigError(f"{source}: file {name!r} of a role is missing; expected it beside the manifest")
    return Folder(where, manifest, {name: texts[name] for name in sorted(used)}, digest)


def _able(
    text: str, name: str, catalogue: Catalogue
) -> tuple[tuple[PlatformKind, ...], dict[str, ParamValue]]:
    """Kinds of vehicle that can execute every block, and the parameters; the check reports errors."""
    try:
        top = parse_source(text, name).value
    except SourceError:
        return VEHICLES, {}
    blocks = top.get("mission") if isinstance(top, dict) else None
    if not isinstance(blocks, dict):
        return VEHICLES, {}
    able = {spec.name: spec.kinds for spec in catalogue.types.values() if spec.kinds}
    types = {
        body["type"] for body in blocks.values() if isinstance(body, dict) and _is_text(body.get("type"))
    }
    kinds = tuple(kind for kind in VEHICLES if all(kind in able.get(word, VEHICLES) for word in types))
    declared = top.get("params")
    params: dict[str, ParamValue] = {}
    for key, default in declared.items() if isinstance(declared, dict) else ():
        with contextlib.suppress(msgspec.ValidationError):
            params[key] = msgspec.convert(default, ParamValue)
    return kinds or VEHICLES, params


def _is_text(value: object) -> bool:
    return isinstance(value, str)
