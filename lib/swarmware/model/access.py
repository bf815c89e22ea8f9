"""Access control of resources: the lowest role for each verb and path."""

from enum import IntEnum, StrEnum
from typing import Final

import msgspec

from swarmware.errors import ConfigError, Denied
from swarmware.model.names import Pattern


class Role(IntEnum):
    """Role of a member on the roster; each has the permissions of those before it."""

    OBSERVER = 1
    """It may read."""
    NODE = 2
    """A platform: it may read, and take part in the functions of the swarm."""
    OPERATOR = 3
    """It may give missions and commands, and change settings."""
    MAINTAINER = 4
    """It may do everything."""

    @classmethod
    def named(cls, name: str) -> "Role":
        """The role of this name.

        Raises: ConfigError.
        """
        try:
            return cls[name.upper()]
        except KeyError:
            names = ", ".join(role.name.lower() for role in cls)
            raise ConfigError(f"role {name!r}: expected one of {names}") from None


class Verb(StrEnum):
    """Operation on a resource."""

    GET = "get"
    """Read its value."""
    SET = "set"
    """Change the value of a setting."""
    CALL = "call"
    """Send its owner a message or request."""


class AccessRule(msgspec.Struct, frozen=True):
    """The lowest role that may perform an operation on matching paths."""

    verb: Verb
    pattern: str
    """Pattern of local paths."""
    role: Role


DEFAULT: Final = (
    AccessRule(Verb.GET, "**", Role.OBSERVER),
    AccessRule(Verb.SET, "**", Role.OPERATOR),
    # the tree itself checks the access to the requested path
    AccessRule(Verb.CALL, "sys/tree/{get,history,list,log,structure,subscribe,type}", Role.OBSERVER),
    AccessRule(Verb.CALL, "sys/tree/{notify,set,undo,reset,rule}", Role.NODE),
    AccessRule(Verb.CALL, "sys/*/{status,state,faults,stats,ls,info,config,apps,functions}", Role.OBSERVER),
    AccessRule(Verb.CALL, "sys/broker/{links,routes,traffic}", Role.OBSERVER),
    AccessRule(Verb.CALL, "sys/{mission,vehicle,health}/**", Role.OPERATOR),
    AccessRule(Verb.CALL, "sys/**", Role.MAINTAINER),
    AccessRule(Verb.CALL, "cmd/**", Role.OPERATOR),
    AccessRule(Verb.CALL, "config/**", Role.OPERATOR),
    AccessRule(Verb.CALL, "**", Role.NODE),
)
"""Default rules: the first that matches decides; without one only maintainers have access."""


class Sender(msgspec.Struct, frozen=True, gc=False):
    """An authenticated member of the swarm, and its role."""

    platform: str
    role: Role

    def __str__(self) -> str:
        return f"{self.role.name.lower()}@{self.platform}"


class Access:
    """Access decisions by a table of rules."""

    def __init__(self, rules: tuple[AccessRule, ...] = DEFAULT) -> None:
        self._rules = tuple((rule.verb, Pattern(rule.pattern), rule.role) for rule in rules)
        self._known: dict[tuple[Verb, str], Role] = {}

    def needed(self, verb: Verb, path: str) -> Role:
        """The lowest role that may perform this operation on a local path."""
        role = self._known.get((verb, path))
        if role is None:
            role = next(
                (role for of, pattern, role in self._rules if of is verb and pattern.matches(path)),
                Role.MAINTAINER,
            )
            if len(self._known) < _KNOWN_MAX:
                self._known[verb, path] = role
        return role

    def check(self, sender: Sender | None, verb: Verb, path: str) -> None:
        """Check a sender; None: this platform itself, or a swarm without keys, always passes.

        Raises: Denied.
        """
        if sender is None:
            return
        needed = self._known.get((verb, path)) or self.needed(verb, path)
        if sender.role < needed:
            raise Denied(
                f"{path}: {sender} may not {verb} it; expected role {needed.name.lower()}"
                + (" or above" if needed < Role.MAINTAINER else "")
            )


_KNOWN_MAX: Final = 4096
