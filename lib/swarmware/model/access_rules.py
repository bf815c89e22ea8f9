"""The access rules of a node while it runs: `acl.toml`, read again after each change."""

import logging
import os
from pathlib import Path
from typing import Final

from swarmware.errors import ConfigError
from swarmware.model.access import DEFAULT, Access
from swarmware.model.acl import FILE, AclConfig, OperatorEntry, load_acl

_Stamp = tuple[int, int, int]
"""Inode, time of the last change and size: with the same ones the file has the same content."""
_UNREAD: Final = (0, 0, 0)

log = logging.getLogger("swarm.access")


class AccessRules:
    """The rules in force. An invalid file never replaces them.

    The file is read at the first use. A change takes effect when two polls in a row found the same file, so
    that a file that is being written is not read.
    """

    def __init__(self, config_dir: Path) -> None:
        self._config_dir = config_dir
        self._path = config_dir / FILE
        self._access = Access(())  # patterns are compiled at the first use
        self._operators: tuple[OperatorEntry, ...] = ()
        self._judged: _Stamp | None = _UNREAD
        """Stamp of the file that is in force or was refused, or None without a file."""
        self._seen: _Stamp | None = None
        self._config: AclConfig | None = None
        self._is_read = False
        self.version = 0
        """Incremented by each change of the rules in force."""
        self.problem = ""
        """Reason for which the present file is not in force, or "" if it is."""

    @property
    def access(self) -> Access:
        """Decisions by the rules in force; the same object, whatever rules come."""
        self._first()
        return self._access

    @property
    def operators(self) -> tuple[OperatorEntry, ...]:
        """Users and groups with a role; none while no valid file was read."""
        self._first()
        return self._operators

    def check(self) -> None:
        """Check that a valid file is or was in force.

        Raises: ConfigError.
        """
        self._first()
        if self._config is None:
            raise ConfigError(self.problem)

    def poll(self) -> None:
        """Read the file again if it has changed; call it at least every few seconds."""
        if not self._is_read:
            return
        stamp = _stamp(self._path)
        if stamp == self._judged:
            self._seen = stamp
        elif stamp != self._seen:
            self._seen = stamp  # its writer may not have finished: wait for the next poll
        else:
            self._judged = stamp
            self._take(stamp)

    def _first(self) -> None:
        if self._is_read:
            return
        self._is_read = True
        self._judged = self._seen = _stamp(self._path)
        try:
            self._put(load_acl(self._config_dir))
        except ConfigError as error:
            self.problem = str(error)
            self._access.set_rules(DEFAULT)
            log.error("users of this computer are observers only: %s", error)

    def _take(self, stamp: _Stamp | None) -> None:
        before = self._config
        if stamp is None:
            self._refuse(f"{self._path}: the file is missing")
            return
        try:
            found = load_acl(self._config_dir)
        except ConfigError as error:
            self._refuse(str(error))
            return
        self.problem = ""
        if found != before:
            self._put(found)
        log.info("%s: %d rules, %d users or groups are in force", FILE, len(found.rule), len(found.operator))

    def _refuse(self, reason: str) -> None:
        self.problem = f"{reason}; the former rules stay in force"
        log.error("%s", self.problem)

    def _put(self, config: AclConfig) -> None:
        self._config = config
        self._access.set_rules(config.rule)
        self._operators = config.operator
        self.version += 1


def _stamp(path: Path) -> _Stamp | None:
    try:
        status = os.stat(path)  # noqa: PTH116  # every second: no Path object
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size
