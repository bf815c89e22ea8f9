"""The file `acl.toml`: who may do what on this node, and the operators among the users of this computer."""

import re
from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.access import DEFAULT, AccessRule, RoleName
from swarmware.model.config import load

FILE: Final = "acl.toml"
_NAME: Final = re.compile(r"[a-z_][a-z0-9_.-]{0,30}")


class OperatorEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A user of this computer, or the members of a group, and their role on this node."""

    name: str = ""
    """Name in records, such as `anna` of `anna@gcs`: [a-z_][a-z0-9_.-]{0,30}, or "" for the name of the
    user."""
    user: str = ""
    """Name of a user of this computer."""
    group: str = ""
    """Name of a group of this computer: its members have the role."""
    role: RoleName = "operator"
    """Highest role; on other platforms the role of this platform limits it, too."""

    def __post_init__(self) -> None:
        """Check constraints between fields; msgspec converts ValueError to its ValidationError."""
        if bool(self.user) == bool(self.group):
            raise InvalidInput("operator: expected either a user or a group")
        if self.group and self.name:
            raise InvalidInput(f"operator: name {self.name!r} of group {self.group!r}: expected a user")
        if self.name and not _NAME.fullmatch(self.name):
            raise InvalidInput(f"operator: name {self.name!r}: expected [a-z_][a-z0-9_.-]{{0,30}}")


class AclConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Access rules of this node, and the operators among the users of its computer (acl.toml)."""

    rule: tuple[AccessRule, ...] = DEFAULT
    """The rules in their order: the first that matches verb and path decides; without a match only
    maintainers may."""
    operator: tuple[OperatorEntry, ...] = (OperatorEntry(group="swarm"),)
    """Users and groups with a role; the entry of a user precedes its groups' entries. Other users are
    observers."""


def load_acl(config_dir: Path) -> AclConfig:
    """The access rules of a node; the default ones where there is no file.

    Raises: ConfigError when the file is invalid.
    """
    path = config_dir / FILE
    return load(path, AclConfig) if path.exists() else AclConfig()
