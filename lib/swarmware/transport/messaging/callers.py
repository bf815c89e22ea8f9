"""Rights of the users of this computer, by the credentials of their sockets."""

import grp
import logging
import os
import pwd
from collections.abc import Callable
from typing import Final

from swarmware.errors import Denied
from swarmware.model.access import Role, Sender, Verb
from swarmware.model.access_rules import AccessRules
from swarmware.model.acl import OperatorEntry
from swarmware.transport.delivery.sender import Caller
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.types.net import Denial

NAME_LIMIT: Final = 31
"""Maximum bytes of a caller's name, as of a platform's."""
log = logging.getLogger("swarm.messages")


class Callers:
    """Roles of the users of this computer on this node.

    Root, the user of the node and the user of this process have the rights of the platform: they could read
    its keys, or change its programs. The access rules are read when another user has connected.
    """

    def __init__(self, rules: AccessRules, platform: str, node_uid: int) -> None:
        self._rules = rules
        self._version = 0
        self._platform = platform
        self._trusted = frozenset({0, node_uid, os.geteuid()})
        self._known: dict[int, Caller] = {}
        self._reporter: DenialReporter | None = None
        self._listeners: dict[Callable[[Denial], None], None] = {}
        self.denied = 0
        """Number of denied messages and requests of users of this computer."""

    def caller(self, uid: int) -> Caller | None:
        """The caller with this user id, or None if it has the rights of the platform."""
        # nearly all senders: no name and no rule is searched for them
        if uid in self._trusted:
            return None
        operators = self._rules.operators
        # the file has changed: roles of users that are connected may be others now
        if self._version != self._rules.version:
            self._version = self._rules.version
            self._known.clear()
        caller = self._known.get(uid)
        if caller is None:
            caller = self._known[uid] = caller_of_user(uid, operators)
        return caller

    def check(self, caller: Caller, path: str, now_ns: int) -> None:
        """Check that a caller may send a message or request to a resource of this platform.

        Raises: Denied.
        """
        try:
            self._rules.access.check(self.sender(caller), Verb.CALL, path)
        except Denied as error:
            self.denied += 1
            self._report(caller, path, str(error), now_ns)
            raise

    def add_listener(self, listener: Callable[[Denial], None]) -> None:
        """Add a function for the reports of denials; only the first of several is called."""
        self._listeners[listener] = None

    def remove_listener(self, listener: Callable[[Denial], None]) -> None:
        """Remove a function that `add_listener` added."""
        self._listeners.pop(listener, None)

    def _report(self, caller: Caller, path: str, reason: str, now_ns: int) -> None:
        if self._reporter is None:
            self._reporter = DenialReporter(self._on_report)
        role = caller.role.name.lower()
        denial = Denial(self._platform, role, str(Verb.CALL), path, 1, reason, caller.name)
        self._reporter.on_denial(denial, now_ns)

    def _on_report(self, report: Denial) -> None:
        log.warning("denied: %s (%d since the last message)", report.reason, report.count)
        if self._listeners:
            next(iter(self._listeners))(report)

    def close(self) -> None:
        """End the reports of denials."""
        if self._reporter is not None:
            self._reporter.close()

    def sender(self, caller: Caller) -> Sender:
        """The caller as the sender of a frame."""
        return Sender(self._platform, caller.role, caller.name)


def caller_of_user(uid: int, operators: tuple[OperatorEntry, ...]) -> Caller:
    """Name and role of a user: by its own entry, else the highest of its groups', else an observer."""
    try:
        user = pwd.getpwuid(uid)
    except KeyError:
        # a user without a name, as in a container; the underscore marks a number
        return Caller(f"_{uid}", Role.OBSERVER)
    name = user.pw_name[:NAME_LIMIT]
    own = next((one for one in operators if one.user == user.pw_name), None)
    if own is not None:
        return Caller(own.name or name, Role.named(own.role))
    # all groups of the user: the process may run with some of them only
    groups = set(os.getgrouplist(user.pw_name, user.pw_gid))
    roles = [Role.named(one.role) for one in operators if _group_id(one.group) in groups]
    return Caller(name, max(roles, default=Role.OBSERVER))


def _group_id(name: str) -> int | None:
    try:
        return grp.getgrnam(name).gr_gid if name else None
    except KeyError:
        return None
