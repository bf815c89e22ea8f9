"""Access control of resources: the lowest role for each verb and path."""

from enum import IntEnum, StrEnum
from typing import Final, Literal

import msgspec

from swarmware.errors import ConfigError, Denied
from swarmware.model.names import Pattern


class Role(IntEnum):
    """Role of a member on the roster; each has the permissions of those before it."""

    OBSERVER = 1
    """Members that may read."""
    NODE = 2
    """Platforms, which may read and take part in the functions of the swarm."""
    OPERATOR = 3
    """Members that may give missions and commands, and change settings."""
    MAINTAINER = 4
    """Members with all permissions."""

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


RoleName = Literal["observer", "node", "operator", "maintainer"]


class Verb(StrEnum):
    """Operation on a resource."""

    GET = "get"
    """Read its value."""
    SET = "set"
    """Change the value of a setting."""
    CALL = "call"
    """Send its owner a message or request."""
    SUBSCRIBE = "subscribe"
    """Receive its values whenever they change."""


class AccessRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The lowest role that may perform an operation on matching paths."""

    verb: Verb
    """Operation: get, subscribe, set or call."""
    path: str
    """Pattern of local paths: `cmd/**`, `sys/*/status`."""
    role: RoleName
    """Lowest role that may do it: observer, node, operator or maintainer."""

    def __post_init__(self) -> None:
        """Check the pattern; msgspec converts ValueError to its ValidationError."""
        Pattern(self.path)


DEFAULT: Final = (
    AccessRule(Verb.GET, "**", "observer"),
    AccessRule(Verb.SUBSCRIBE, "**", "observer"),
    AccessRule(Verb.SET, "**", "operator"),
    # the tree itself checks the access to the requested path
    AccessRule(
        Verb.CALL, "sys/tree/{channels,get,history,list,log,placement,structure,subscribe,type}", "observer"
    ),
    AccessRule(Verb.CALL, "sys/tree/{notify,set,undo,reset,rule}", "node"),
    AccessRule(
        Verb.CALL, "sys/*/{status,state,faults,stats,ls,info,config,apps,functions,queue}", "observer"
    ),
    AccessRule(Verb.CALL, "sys/mission/{history,run}", "observer"),
    AccessRule(Verb.CALL, "sys/broker/{links,outages,routes,traffic}", "observer"),
    AccessRule(Verb.CALL, "sys/video/open", "node"),
    AccessRule(Verb.CALL, "sys/{files,mission,vehicle,health,video}/**", "operator"),
    AccessRule(Verb.CALL, "sys/broker/{set_channel,undo_channel,clear_channels}", "operator"),
    AccessRule(Verb.CALL, "sys/**", "maintainer"),
    AccessRule(Verb.CALL, "cmd/**", "operator"),
    AccessRule(Verb.CALL, "config/**", "operator"),
    AccessRule(Verb.CALL, "**", "node"),
)
"""Default rules: the first that matches decides; without one only maintainers have access."""


class Sender(msgspec.Struct, frozen=True, gc=False):
    """An authenticated member of the swarm or user of its computer, and its role."""

    platform: str
    role: Role
    caller: str = ""
    """User of that platform's computer, as its sockets authenticate it, or "" for the platform itself."""
    via: tuple[str, ...] = ()
    """Platforms that forwarded the frame, the first one first; only the last one is certain."""

    def __str__(self) -> str:
        return f"{self.caller or self.role.name.lower()}@{self.platform}"


class Access:
    """Access decisions by a table of rules."""

    def __init__(self, rules: tuple[AccessRule, ...] = DEFAULT) -> None:
        self._rules: tuple[tuple[Verb, Pattern, Role], ...] = ()
        self._known: dict[tuple[Verb, str], Role] = {}
        self.set_rules(rules)

    def set_rules(self, rules: tuple[AccessRule, ...]) -> None:
        """Decide by other rules from now on."""
        self._rules = tuple((rule.verb, Pattern(rule.path), Role.named(rule.role)) for rule in rules)
        self._known.clear()

    def needed(self, verb: Verb, path: str) -> Role:
        """The lowest role that may perform this operation on a local path."""
        role = self._known.get((verb, path))
        if role is None:
            role = next(
                (role for of, pattern, role in self._rules if of is verb and pattern.matches(path)),
                Role.MAINTAINER,
            )
            # Paths come from other platforms: the cache must not grow with invented ones.
            if len(self._known) < _KNOWN_MAX:
                self._known[verb, path] = role
        return role

    def permits(self, sender: Sender | None, verb: Verb, path: str) -> bool:
        """Whether a sender may do it; None is this platform itself, or any sender in a swarm without keys."""
        return sender is None or sender.role >= self.needed(verb, path)

    def check(self, sender: Sender | None, verb: Verb, path: str) -> None:
        """Check a sender; None always passes: this platform itself, or any sender in a swarm without keys.

        Raises: Denied.
        """
        if sender is None:
            return
        needed = self._known.get((verb, path)) or self.needed(verb, path)
        if sender.role < needed:
            role = f" ({sender.role.name.lower()})" if sender.caller else ""
            raise Denied(
                f"{path}: {sender}{role} may not {verb} it; expected role {needed.name.lower()}"
                + (" or above" if needed < Role.MAINTAINER else "")
            )


_KNOWN_MAX: Final = 4096
