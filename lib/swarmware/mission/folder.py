"""A mission of an ensemble: a manifest (mission.toml) that assigns files to roles, and the files.

Without a manifest, a folder for each member has its file: `<id>/mission.json`. The id is the name of a
platform, or a number; numbers are filled with platforms in natural order.
"""

import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import ConfigError, NotFound
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import Catalogue, built_in
from swarmware.mission.manifest import (
    MANIFEST,
    MEMBER_FILE,
    ROLE_REFERENCE,
    Manifest,
    RoleSpec,
    Series,
    read_manifest,
)
from swarmware.mission.model import content_hash
from swarmware.mission.source import SourceError
from swarmware.mission.source import parse as parse_source
from swarmware.model import document
from swarmware.model.names import natural
from swarmware.model.platform_kind import VEHICLES, PlatformKind
from swarmware.types.bounds import is_file_name
from swarmware.types.mission import MissionFile, ParamValue

FILE_LIMIT: Final = 64
"""Maximum number of files of one mission."""


class Folder(msgspec.Struct, frozen=True):
    """A mission with the contents of all its files."""

    where: str
    """Origin for error messages: a path, or the name of the sender."""
    manifest: Manifest
    texts: dict[str, str]
    """Contents of the roles' files, by name."""
    hash: str
    """BLAKE2b-128 of names and contents, hex."""
    manifest_text: str = ""
    """Text of the manifest, or "" if it was made for a single file."""

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
        name: first.get(value.removeprefix(ROLE_REFERENCE), value)
        if isinstance(value, str) and value.startswith(ROLE_REFERENCE)
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
        names = _without_manifest(folder)
        if not names:
            raise NotFound(
                f"{path}: no {MANIFEST} in it; expected a mission folder ({MANIFEST}, {MEMBER_FILE} or "
                f"<id>/{MEMBER_FILE}), or a BDL file"
            )
        return [MissionFile(name, document.read(folder / name)) for name in names]
    text = document.read(folder / MANIFEST)
    manifest = read_manifest(text, str(folder / MANIFEST))
    names = sorted({role.file for role in manifest.roles})
    # `from_files` reports a missing one
    there = [folder / name for name in names if (folder / name).is_file()]
    return [MissionFile(MANIFEST, text), *(MissionFile(file.name, document.read(file)) for file in there)]


def is_mission(folder: Path) -> bool:
    """Whether a folder has a mission: a manifest, or the files that it may have instead."""
    return (folder / MANIFEST).is_file() or bool(_without_manifest(folder))


def _without_manifest(folder: Path) -> list[str]:
    """Names of the files of a mission that has no manifest: one, or one in the folder of each member."""
    if (folder / MEMBER_FILE).is_file():
        return [MEMBER_FILE]
    if not folder.is_dir():
        return []
    names = [f"{member.name}/{MEMBER_FILE}" for member in folder.iterdir() if is_file_name(member.name)]
    return sorted((name for name in names if (folder / name).is_file()), key=natural)


def read_folder(path: Path, catalogue: Catalogue | None = None) -> Folder:
    """The mission at this path: a folder with a manifest or with a folder for each member, or one BDL file.

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
    manifest_text = ""
    if MANIFEST in texts:
        manifest_text = texts.pop(MANIFEST)
        manifest = read_manifest(manifest_text, source)
    elif all(name.endswith(f"/{MEMBER_FILE}") for name in texts):
        roles = [_member_role(name, text, catalogue or built_in()) for name, text in texts.items()]
        # a role that names its platform takes it before the others are filled
        roles.sort(key=lambda role: (not role.platform, natural(role.name)))
        manifest = Manifest(name=Path(where).name[:64] or "mission", roles=tuple(roles))
    elif len(texts) == 1:
        ((name, text),) = texts.items()
        kinds, params = _able(text, name, catalogue or built_in())
        role = RoleSpec(name="all", file=name, kinds=kinds)
        title = Path(where).name if name == MEMBER_FILE else name.removesuffix(".json")
        manifest = Manifest(name=title[:64] or "mission", roles=(role,), params=params)
    else:
        raise ConfigError(f"{where}: {len(files)} files without {MANIFEST}; expected it, or a single file")
    for number, role in enumerate(manifest.roles):
        if role.file not in texts:
            message = f"key roles[{number}].file: {role.file!r} is missing; expected it beside {MANIFEST}"
            raise document.refusal(source, manifest_text, ("roles", number, "file"), message)
    used = {role.file: texts[role.file] for role in manifest.roles}
    return Folder(where, manifest, dict(sorted(used.items())), digest, manifest_text)


def _member_role(file: str, text: str, catalogue: Catalogue) -> RoleSpec:
    """The role of the member whose id is the folder of its file: a platform's name, or a number."""
    member = file.rpartition("/")[0]
    platform = "" if member.isdecimal() else member
    # the name may belong to the ground station, too
    kinds, params = _able(text, file, catalogue, (*VEHICLES, PlatformKind.GCS) if platform else VEHICLES)
    return RoleSpec(name=member, file=file, kinds=kinds, take=1, platform=platform, params={**params})


def _able(
    text: str, name: str, catalogue: Catalogue, players: tuple[PlatformKind, ...] = VEHICLES
) -> tuple[tuple[PlatformKind, ...], dict[str, ParamValue]]:
    """Kinds of these players that can execute every block, and the parameters; the check reports errors."""
    try:
        top = parse_source(text, name).value
    except SourceError:
        return players, {}
    blocks = top.get("mission") if isinstance(top, dict) else None
    if not isinstance(blocks, dict):
        return players, {}
    able = {spec.name: spec.kinds for spec in catalogue.types.values() if spec.kinds}
    types = {
        body["type"] for body in blocks.values() if isinstance(body, dict) and _is_text(body.get("type"))
    }
    kinds = tuple(kind for kind in players if all(kind in able.get(word, players) for word in types))
    declared = top.get("params")
    params: dict[str, ParamValue] = {}
    for key, default in declared.items() if isinstance(declared, dict) else ():
        with contextlib.suppress(msgspec.ValidationError):
            params[key] = msgspec.convert(default, ParamValue)
    return kinds or players, params


def _is_text(value: object) -> bool:
    return isinstance(value, str)
