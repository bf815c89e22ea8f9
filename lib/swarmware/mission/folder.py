"""A mission of an ensemble: a manifest (mission.toml) that says who plays which file, and the files."""

from collections.abc import Iterable
from hashlib import blake2b
from pathlib import Path
from typing import Annotated, Final

import msgspec

from swarmware.config import parse as parse_toml
from swarmware.errors import ConfigError, NotFound
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import Name
from swarmware.types.mission import MissionFile, ParamValue

MANIFEST: Final = "mission.toml"
FILE_LIMIT: Final = 64
"""Files of one mission."""
KINDS: Final = ("uav", "ugv", "usv", "gcs")

FileName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$")]


class Series(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Another value for each platform of a role: first, first + step, …"""

    first: int | float
    step: int | float

    def at(self, index: int) -> float:
        """Value of the role's index-th platform, from 0."""
        return self.first + self.step * index


class RoleSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part in the mission."""

    name: Name
    file: FileName
    """Its BDL file."""
    kinds: tuple[str, ...]
    """Kinds of platform that can play it."""
    take: Annotated[int, msgspec.Meta(ge=0, le=1_000)] = 0
    """How many platforms play it; 0: all that are left of these kinds."""
    required: bool = True
    """Without a platform for it nobody starts."""
    params: dict[str, ParamValue | Series] = {}
    """Instead of the defaults in the file."""

    def __post_init__(self) -> None:
        """Kinds are known ones."""
        if not self.kinds or any(kind not in KINDS for kind in self.kinds):
            raise ValueError(f"kinds of role {self.name!r}: expected some of {', '.join(KINDS)}")


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """mission.toml."""

    name: Name
    title: str = ""
    roles: tuple[RoleSpec, ...]
    """Filled in this order, with platforms in natural order of their names (uav2 before uav10)."""
    params: dict[str, ParamValue] = {}
    """For all roles; a text `$role.<name>` stands for the first platform that plays it."""

    def __post_init__(self) -> None:
        """Roles exist and have names of their own."""
        names = [role.name for role in self.roles]
        if not names or len(set(names)) != len(names):
            raise ValueError("roles: expected at least one, each with a name of its own")


class Folder(msgspec.Struct, frozen=True):
    """A mission with all its files, wherever they came from."""

    where: str
    """For errors: a path, or the name of the one who sent it."""
    manifest: Manifest
    texts: dict[str, str]
    """The roles' files."""
    hash: str
    """BLAKE2b-128 of names and contents, hex."""

    def place(self, file: str) -> str:
        """A file as it is called in findings."""
        return f"{self.where}/{file}" if self.where else file

    def param_names(self) -> set[str]:
        """All parameters that the manifest gives."""
        return set(self.manifest.params).union(*(role.params for role in self.manifest.roles))

    def example(self, role: RoleSpec) -> Binding:
        """A binding as the role's first platform would get it, for checks."""
        first = {other.name: f"{other.kinds[0]}1" for other in self.manifest.roles}
        params = {**self.manifest.params, **self.role_params(role, 0)}
        return Binding(
            first[role.name], role.kinds[0], role.name, self.manifest.name, name_roles(params, first)
        )

    @staticmethod
    def role_params(role: RoleSpec, index: int) -> dict[str, ParamValue]:
        """The role's own parameters for its index-th platform."""
        return {
            name: value.at(index) if isinstance(value, Series) else value
            for name, value in role.params.items()
        }


def name_roles(params: dict[str, ParamValue], first: dict[str, str]) -> dict[str, ParamValue]:
    """The parameters with `$role.<name>` replaced by the platform that plays the role first."""
    return {
        name: first.get(value.removeprefix("$role."), value)
        if isinstance(value, str) and value.startswith("$role.")
        else value
        for name, value in params.items()
    }


def content_hash(*parts: str) -> str:
    """BLAKE2b-128 of the texts, each with its length, hex."""
    state = blake2b(digest_size=16)
    for part in parts:
        data = part.encode()
        state.update(len(data).to_bytes(8, "little"))
        state.update(data)
    return state.hexdigest()


def files_hash(files: Iterable[MissionFile]) -> str:
    """The hash of a mission made of these files, in whatever order."""
    named = sorted((file.name, file.text) for file in files)
    return content_hash(*(part for pair in named for part in pair))


def read_folder(path: Path) -> Folder:
    """The mission in this folder.

    Raises: NotFound without a manifest; ConfigError when it does not fit or a file is missing.
    """
    manifest_path = path / MANIFEST
    if not manifest_path.is_file():
        raise NotFound(f"{path}: no {MANIFEST} in it; expected a mission folder")
    files = sorted(file for file in path.iterdir() if file.name == MANIFEST or file.suffix == ".json")
    try:
        return from_files([MissionFile(file.name, file.read_text("utf-8")) for file in files], str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error


def from_files(files: list[MissionFile] | tuple[MissionFile, ...], where: str) -> Folder:
    """The mission made of these files; one BDL file alone is a mission for every vehicle.

    Raises: ConfigError when the manifest does not fit or names a file that is not there.
    """
    if not 1 <= len(files) <= FILE_LIMIT:
        raise ConfigError(f"{where}: {len(files)} files; expected 1 to {FILE_LIMIT}")
    texts = {file.name: file.text for file in files}
    if len(texts) != len(files):
        raise ConfigError(f"{where}: two files of one name; expected each once")
    digest = files_hash(files)
    source = f"{where}/{MANIFEST}" if where else MANIFEST
    if MANIFEST in texts:
        manifest = parse_toml(texts.pop(MANIFEST), Manifest, source)
    elif len(texts) == 1:
        (name,) = texts
        role = RoleSpec(name="all", file=name, kinds=("uav", "ugv", "usv"))
        manifest = Manifest(name=name.removesuffix(".json")[:64] or "mission", roles=(role,))
    else:
        raise ConfigError(f"{where}: {len(files)} files without {MANIFEST}; expected it, or a single file")
    used = {role.file for role in manifest.roles}
    for name in sorted(used - texts.keys()):
        raise ConfigError(f"{source}: file {name!r} of a role is missing; expected it beside the manifest")
    return Folder(where, manifest, {name: texts[name] for name in sorted(used)}, digest)
