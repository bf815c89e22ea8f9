"""Who may do what with the resources of a platform: the lowest role for each verb and path."""

from enum import IntEnum, StrEnum
from typing import Final

import msgspec

from swarmware.errors import ConfigError, Denied
from swarmware.model.names import Pattern


class Role(IntEnum):
    """Role of a member on the roster; each may do what those before it may."""

    OBSERVER = 1
    """Reads."""
    NODE = 2
    """A platform: besides reading it takes part in what platforms do together."""
    OPERATOR = 3
    """Gives missions and commands, changes settings."""
    MAINTAINER = 4
    """Everything."""

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
    """What a sender wants of a resource."""

    GET = "get"
    """Its value."""
    SET = "set"
    """Another value of a setting."""
    CALL = "call"
    """That its owner takes a message or request."""


class AccessRule(msgspec.Struct, frozen=True):
    """The lowest role that may do this to paths that match."""

    verb: Verb
    pattern: str
    """Of local paths."""
    role: Role


DEFAULT: Final = (
    AccessRule(Verb.GET, "**", Role.OBSERVER),
    AccessRule(Verb.SET, "**", Role.OPERATOR),
    # the tree looks itself at the path that it is asked about
    AccessRule(Verb.CALL, "sys/tree/{get,list,structure,subscribe}", Role.OBSERVER),
    AccessRule(Verb.CALL, "sys/tree/{notify,set,undo}", Role.NODE),
    AccessRule(Verb.CALL, "sys/*/{status,state,faults,stats,ls,info,apps,functions}", Role.OBSERVER),
    AccessRule(Verb.CALL, "sys/broker/{links,routes,traffic}", Role.OBSERVER),
    AccessRule(Verb.CALL, "sys/{mission,vehicle,health}/**", Role.OPERATOR),
    AccessRule(Verb.CALL, "sys/**", Role.MAINTAINER),
    AccessRule(Verb.CALL, "cmd/**", Role.OPERATOR),
    AccessRule(Verb.CALL, "config/**", Role.OPERATOR),
    AccessRule(Verb.CALL, "**", Role.NODE),
)
"""The first rule that matches decides; nothing but maintainers where none does."""


class Sender(msgspec.Struct, frozen=True, gc=False):
    """A member of the swarm whose connection proved who it is."""

    platform: str
    role: Role

    def __str__(self) -> str:
        return f"{self.role.name.lower()}@{self.platform}"


class Access:
    """Decides by a table of rules."""

    def __init__(self, rules: tuple[AccessRule, ...] = DEFAULT) -> None:
        self._rules = tuple((rule.verb, Pattern(rule.pattern), rule.role) for rule in rules)
        self._known: dict[tuple[Verb, str], Role] = {}

    def needed(self, verb: Verb, path: str) -> Role:
        """The lowest role that may do this to a local path."""
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
        """Whether the sender may. None: this platform itself, or a swarm without keys; it may.

        Raises: Denied.
        """
        if sender is None:
            return
        needed = self.needed(verb, path)
        if sender.role < needed:
            raise Denied(
                f"{path}: {sender} may not {verb} it; expected role {needed.name.lower()}"
                + (" or above" if needed < Role.MAINTAINER else "")
            )


_KNOWN_MAX: Final = 4096
