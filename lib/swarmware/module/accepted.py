"""Commands as an application accepted them: a ring beside its inbox, from which the logger takes them."""

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
"""The logger looks ten times a second; a vehicle is not commanded faster than this."""
SLOT_BYTES: Final = 4096
"""An order of a mission; a longer one makes it grow."""

log = logging.getLogger("swarm.module")


class Accepted:
    """Publishes each accepted message or request once, stamped at its acceptance."""

    def __init__(self, node: "Node", path: str) -> None:
        self._node = node
        self._path = path
        self._publication: Publication | None = None
        try:
            self._publication = self._open()  # now, not when the first command waits for it
        except SwarmError as error:
            self._complain(error)

    def take(self, frame: Frame) -> None:
        """An accepted one: what the sender wrote, who it was, and when it came."""
        kept = copy.copy(frame)
        kept.stamp_ns = self._node.clock.now_ns()  # of our clock, as all other stamps of this platform
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
        """Stop; what is not yet logged stays readable."""
        if self._publication is not None:
            self._publication.close(unlink=False)
            self._publication = None


def acceptance(node: "Node", path: str, track: Callable[[Accepted], object]) -> Accepted | None:
    """Where accepted commands of this path are kept for the logger; None when it is not logged.

    `track` takes it, to close it with the module.
    """
    try:
        wanted = path in recorded(node.config.template, node.config.share_path / "templates")
    except ConfigError as error:
        log.warning("%s: whether it is logged is unknown: %s", path, error)
        return None
    if not wanted:
        return None
    accepted = Accepted(node, path)
    track(accepted)
    return accepted


@lru_cache(maxsize=8)
def recorded(template_name: str, folder: Path) -> frozenset[str]:
    """Commands that the template says are logged.

    Raises: ConfigError when the template cannot be used.
    """
    from swarmware.model import template
    from swarmware.model.resource import Kind

    return frozenset(
        resource.path
        for resource in template.load(template_name, folder).resources
        if resource.kind is Kind.COMMAND and resource.log_hz
    )
