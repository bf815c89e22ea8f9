"""Records the commands that an application accepts in a ring, which the logger reads."""

import copy
import logging
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from swarmware.errors import ConfigError, SwarmError
from swarmware.model.frame import Frame, encode

if TYPE_CHECKING:
    from swarmware.node.node import Node
    from swarmware.node.publication import Publication

SLOTS: Final = 16
"""Slots of the ring: the logger reads ten times a second, and commands are rarer."""
SLOT_BYTES: Final = 4096
"""Size of a slot: the order of a mission fits; the ring is replaced for a longer one."""

log = logging.getLogger("swarm.module")


class Accepted:
    """Publishes each accepted message or request once, stamped at its acceptance."""

    def __init__(self, node: "Node", path: str) -> None:
        self._node = node
        self._path = path
        self._publication: Publication | None = None
        try:
            self._publication = self._open()  # opened now, so that the first command is not delayed
        except SwarmError as error:
            self._complain(error)

    def take(self, frame: Frame) -> None:
        """Record an accepted command with its sender and time."""
        kept = copy.copy(frame)
        kept.stamp_ns = self._node.clock.now_ns()  # on the own clock, as all other stamps of this platform
        try:
            if self._publication is None:
                self._publication = self._open()
            self._publication.publish(encode(kept))
        except SwarmError as error:
            self._complain(error)

    def _open(self) -> "Publication":
        return self._node.publication(self._path, slots=SLOTS, slot_bytes=SLOT_BYTES)

    def _complain(self, error: SwarmError) -> None:
        log.warning("%s: a command is not recorded: %s", self._path, error)

    def close(self) -> None:
        """Stop recording; commands that are not logged yet stay readable."""
        if self._publication is not None:
            self._publication.close(unlink=False)
            self._publication = None


def acceptance(node: "Node", path: str, track: Callable[[Accepted], object]) -> Accepted | None:
    """The recorder for commands of this path, or None if they are not logged.

    `track` gets it, so that the module closes it.
    """
    try:
        wanted = path in recorded(node.config.template, node.config.share_path / "templates")
    except ConfigError as error:
        log.warning("%s: cannot determine whether it is logged: %s", path, error)
        return None
    if not wanted:
        return None
    accepted = Accepted(node, path)
    track(accepted)
    return accepted


@lru_cache(maxsize=8)
def recorded(template_name: str, folder: Path) -> frozenset[str]:
    """Paths of the commands that are logged according to the template.

    Raises: ConfigError when the template cannot be used.
    """
    from swarmware.model import template
    from swarmware.model.resource import Kind

    return frozenset(
        resource.path
        for resource in template.load(template_name, folder).resources
        if resource.kind is Kind.COMMAND and resource.log_hz
    )
