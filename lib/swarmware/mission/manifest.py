"""The manifest of a mission folder (mission.toml): roles, their files and platforms, and parameters."""

from collections.abc import Iterator
from typing import Annotated, Final

import msgspec

from swarmware.mission.catalogue import Name
from swarmware.mission.reaction import ReactionRow, misnamed
from swarmware.model import document
from swarmware.model.config import convert
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.toml_lines import KeyPath, key_text
from swarmware.types.bounds import MemberFileName
from swarmware.types.mission import ParamValue

MANIFEST: Final = "mission.toml"
MEMBER_FILE: Final = "mission.json"
"""Name of the file in a mission folder, or in a member's folder of it, without a manifest."""
ROLE_REFERENCE: Final = "$role."
"""Start of a parameter that means the first platform with a role."""


class Series(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A parameter that differs for each platform of a role: first, first + step, …"""

    first: int | float
    """Value of the role's first platform."""
    step: int | float
    """Difference of two successive platforms."""

    def at(self, index: int) -> float:
        """Value of the role's index-th platform, from 0."""
        return self.first + self.step * index


class RoleSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One role in the manifest."""

    name: Name
    """Name of the role, unique in the mission."""
    file: Annotated[
        MemberFileName,
        msgspec.Meta(description="the name of a file in the mission's folder, such as air.json"),
    ]
    """Name of the role's BDL file, beside the manifest."""
    kinds: Annotated[tuple[PlatformKind, ...], msgspec.Meta(min_length=1)]
    """Kinds of platform that can have the role."""
    take: Annotated[int, msgspec.Meta(ge=0, le=1_000)] = 0
    """Number of platforms with the role, or 0 for all remaining platforms of these kinds."""
    platform: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """Name of the only platform that can have the role, or "" for any of these kinds."""
    required: bool = True
    """The mission does not start without a platform for this role."""
    params: dict[str, ParamValue | Series] = {}
    """Values that replace the defaults in the role's file: a value for all its platforms, or a series."""


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contents of a mission folder's `mission.toml`."""

    name: Name
    """Name of the mission."""
    title: str = ""
    """Text for operators about the purpose of the mission."""
    roles: Annotated[tuple[RoleSpec, ...], msgspec.Meta(min_length=1)]
    """Roles are assigned in this order, to platforms in natural order of their names (uav2 before uav10)."""
    params: dict[str, ParamValue] = {}
    """Parameters of all roles; a text `$role.<name>` means the first platform with that role."""
    reaction: tuple[ReactionRow, ...] = ()
    """Reactions to faults while the mission runs; each precedes the platform's own row of the same name."""


def read_manifest(text: str, source: str) -> Manifest:
    """Read a manifest; `source` is named in errors.

    Raises: ConfigError with source, line, key and the expected value.
    """
    manifest = convert(document.toml(text, source), Manifest, source, text)
    for path, message in _contradictions(manifest):
        raise document.refusal(source, text, path, f"key {key_text(path)}: {message}")
    return manifest


def _contradictions(manifest: Manifest) -> Iterator[tuple[KeyPath, str]]:
    """Check constraints that the types do not express."""
    for number, message in misnamed(manifest.reaction):
        yield ("reaction", number, "name"), message
    names: list[str] = []
    for number, role in enumerate(manifest.roles):
        if role.name in names:
            yield ("roles", number, "name"), f"{role.name!r} is a role already; expected unique names"
        names.append(role.name)
        for index, kind in enumerate(role.kinds):
            # a later version may know more kinds; the type keeps them for its error text
            if not kind.known:
                yield (
                    ("roles", number, "kinds", index),
                    f"unknown kind {kind.value!r}; expected one of {', '.join(PlatformKind)}",
                )


def parameter_places(manifest: Manifest) -> Iterator[tuple[str, KeyPath]]:
    """Name and path of each parameter that the manifest gives."""
    for name in manifest.params:
        yield name, ("params", name)
    for number, role in enumerate(manifest.roles):
        for name in role.params:
            yield name, ("roles", number, "params", name)
