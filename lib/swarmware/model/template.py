"""Resource templates: TOML files with the resources of a kind of platform, with inheritance."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
from msgspec import UNSET, Meta, UnsetType

from swarmware.errors import ConfigError, InvalidInput
from swarmware.footprint.blake2b import blake2b
from swarmware.model import config, document
from swarmware.model.names import Pattern
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Access, Category, Kind, Link, Plain, Resource, clash_text, clashes

HASH_BYTES: Final = 8
"""Size of a hash: a swarm has few templates, for which 64 bits suffice."""

_ENDING = ".toml"
_encoder = msgspec.msgpack.Encoder()


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Entry of one resource in one file; omitted fields are inherited."""

    # the fields of a `Resource` once more, because each may be missing and its limits are in the schema for
    # editors; made from them the type checker and the schema would lose both

    kind: Kind | UnsetType = UNSET
    type: str | UnsetType = UNSET
    reply: str | UnsetType = UNSET
    unit: str | UnsetType = UNSET
    range: tuple[float, float] | UnsetType = UNSET
    choices: tuple[str, ...] | UnsetType = UNSET
    access: Access | UnsetType = UNSET
    rate_hz: Annotated[float, Meta(ge=0)] | UnsetType = UNSET
    critical: bool | UnsetType = UNSET
    max_age_s: Annotated[float, Meta(ge=0)] | UnsetType = UNSET
    category: Category | UnsetType = UNSET
    link: Link | UnsetType = UNSET
    log: Annotated[str, Meta(pattern="^(all|none|[0-9]+([.][0-9]+)?hz)$")] | UnsetType = UNSET
    owner: str | UnsetType = UNSET
    default: Plain | UnsetType = UNSET
    confirm: str | UnsetType = UNSET
    description: str | UnsetType = UNSET


class TemplateFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One file of the templates folder."""

    description: str = ""
    kinds: tuple[PlatformKind, ...] = ()
    """Kinds of platforms that it describes."""
    extends: str | tuple[str, ...] = ()
    remove: tuple[str, ...] = ()
    resources: dict[str, Entry] = {}

    def __post_init__(self) -> None:
        """Check that the kinds are known."""
        if unknown := [kind for kind in self.kinds if not kind.known]:
            raise InvalidInput(
                f"key kinds: invalid enum value {unknown[0].value!r}; "
                f"expected some of {', '.join(PlatformKind)}"
            )


class Template(msgspec.Struct, frozen=True):
    """Resources of a kind of platform, with inheritance applied."""

    name: str
    description: str
    resources: tuple[Resource, ...]
    """Resources, sorted by path."""
    kinds: tuple[PlatformKind, ...] = ()
    """Kinds of platforms that it describes, or () if neither the file nor its bases name one."""

    @property
    def digest(self) -> bytes:
        """Hash of the resources: nodes with the same hash need not exchange them."""
        return digest(self.resources)


def digest(resources: tuple[Resource, ...]) -> bytes:
    """Hash of a sorted sequence of descriptors."""
    return blake2b(_encoder.encode(resources), digest_size=HASH_BYTES).digest()


def schema() -> dict[str, Any]:
    """JSON Schema of a template file, for editors and other programs."""
    out = msgspec.json.schema(TemplateFile)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Swarmware resource template",
    } | out


def load(name: str, folder: Path, files: dict[Path, TemplateFile] | None = None) -> Template:
    """The template `<folder>/<name>.toml` with everything it inherits.

    `files`: files read for other templates, which share their bases; the files read now are added.

    Raises: ConfigError naming file, path and the expected value.
    """
    files = {} if files is None else files
    merged: dict[str, dict[str, Any]] = {}
    origin: dict[str, str] = {}
    top = _merge(name, folder, (), merged, origin, files)
    resources = tuple(_resource(path, merged[path], origin[path]) for path in sorted(merged))
    _refuse_leaf_parents(resources, origin)
    for path, other in clashes(resources).items():
        raise ConfigError(f"{origin[path]}: key resources: {clash_text(path, other)}")
    return Template(name, top.description, resources, _kinds(top, folder, files))


def _kinds(file: TemplateFile, folder: Path, files: dict[Path, TemplateFile]) -> tuple[PlatformKind, ...]:
    """Kinds of the file itself, or else of its bases, the last base first."""
    for parent in () if file.kinds else reversed(_parents(file)):
        if kinds := _kinds(_read(folder / (parent + _ENDING), files), folder, files):
            return kinds
    return file.kinds


def _parents(file: TemplateFile) -> tuple[str, ...]:
    return (file.extends,) if isinstance(file.extends, str) else file.extends


def names_in(folder: Path) -> list[str]:
    """Names of the templates in a folder."""
    return sorted(path.stem for path in folder.glob("*" + _ENDING))


def whole(folder: Path) -> list[Template]:
    """The templates of platforms, without those that are only bases of others.

    Raises: ConfigError when a template is invalid.
    """
    names, files = names_in(folder), dict[Path, TemplateFile]()
    parts = {parent for name in names for parent in _parents(_read(folder / (name + _ENDING), files))}
    return [found for name in names if (found := load(name, folder, files)).kinds or name not in parts]


def _merge(
    name: str,
    folder: Path,
    trail: tuple[str, ...],
    merged: dict[str, dict[str, Any]],
    origin: dict[str, str],
    files: dict[Path, TemplateFile],
) -> TemplateFile:
    """Merges the file and its bases into `merged`; `trail`: the files that extend it."""
    source = folder / (name + _ENDING)
    if name in trail:
        raise ConfigError(
            f"{folder / (trail[-1] + _ENDING)}: key extends: {' → '.join((*trail, name))} is a circle"
        )
    if not source.is_file():
        where = f"{folder / (trail[-1] + _ENDING)}: key extends: " if trail else f"{folder}: "
        known = ", ".join(names_in(folder)) or "the folder has none"
        raise ConfigError(f"{where}no template {name!r}; expected one of: {known}")
    file = _read(source, files)
    for parent in _parents(file):
        _merge(parent, folder, (*trail, name), merged, origin, files)
    # After the bases, whose resources it removes, and before the own ones, which may replace them.
    for text in file.remove:
        _remove(text, str(source), merged)
    for path, entry in file.resources.items():
        fields = {
            field: value for field in Entry.__struct_fields__ if (value := getattr(entry, field)) is not UNSET
        }
        merged[path] = merged.get(path, {}) | fields
        origin[path] = str(source)
    return file


def _read(source: Path, files: dict[Path, TemplateFile]) -> TemplateFile:
    """The file, parsed once; `files`: those that were read already, as bases of others."""
    if (known := files.get(source)) is None:
        known = files[source] = _parse(source)
    return known


def _parse(source: Path) -> TemplateFile:
    try:
        raw = document.toml(document.read(source), str(source))
    except FileNotFoundError as error:
        raise ConfigError(f"{source}: was removed meanwhile; expected a template") from error
    resources = raw.get("resources")
    if not isinstance(resources, Mapping):
        return config.convert(raw, TemplateFile, str(source))
    # One by one, so that an error names the path and not only "resources[...]".
    entries = {
        path: config.convert(table, Entry, f'{source}: resources."{path}"')
        for path, table in resources.items()
    }
    rest = config.convert({**raw, "resources": {}}, TemplateFile, str(source))
    return msgspec.structs.replace(rest, resources=entries)


def _remove(text: str, source: str, merged: dict[str, dict[str, Any]]) -> None:
    try:
        pattern = Pattern(text)
    except InvalidInput as error:
        raise ConfigError(f"{source}: key remove: {error}") from error
    gone = [path for path in merged if pattern.matches(path)]
    if not gone:
        raise ConfigError(f"{source}: key remove: {text!r} matches nothing; expected an inherited path")
    for path in gone:
        del merged[path]


def _resource(path: str, fields: dict[str, Any], source: str) -> Resource:
    try:
        return Resource(path=path, **fields)
    except InvalidInput as error:
        raise ConfigError(f'{source}: resources."{path}": {error}') from error


def _refuse_leaf_parents(resources: tuple[Resource, ...], origin: dict[str, str]) -> None:
    leaves = {resource.path for resource in resources if resource.kind is not Kind.BRANCH}
    for resource in resources:
        parent = resource.path.rpartition("/")[0]
        while parent:
            if parent in leaves:
                raise ConfigError(
                    f'{origin[resource.path]}: resources."{resource.path}": {parent} has a value; '
                    "expected a branch above it"
                )
            parent = parent.rpartition("/")[0]
