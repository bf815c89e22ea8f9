"""A station that invites new nodes."""

import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.ports import free_port

from swarmctl.commandline.settings import CliSettings
from swarmctl.membership.inviting import InvitationPlan, invite_nodes
from swarmctl.terminal.output import Output
from swarmware.errors import (
    SwarmError,
)
from swarmware.transport.security.keys import Keys

WAIT_S = 30.0
"""Limit of a test, for a loaded computer; a step takes milliseconds."""


class Station(Output):
    """A computer with a node, and what a command printed there."""

    def __init__(self, config_dir: Path, **options: Any) -> None:
        self.stdout, self.stderr = io.StringIO(), io.StringIO()
        super().__init__(CliSettings(config=str(config_dir), **options), self.stdout, self.stderr)
        self.keys_dir = config_dir.parent / "keys"

    def keys(self, platform: str) -> Keys:
        return Keys.load(self.keys_dir, platform)


def plan(*platforms: str, valid_s: float = WAIT_S, role: str = "node", **more: str) -> InvitationPlan:
    address = more.pop("address", "" if "file" in more else f"127.0.0.1:{free_port()}")
    return InvitationPlan(platforms or ("uav1",), role, valid_s, address, **more)


@contextmanager
def inviting_at(base: Station, root: Path, wanted: InvitationPlan) -> Iterator[Callable[[str], str]]:
    """`keys invite` in another thread; the token of a platform as soon as it is printed."""
    failures: list[SwarmError] = []

    def run() -> None:
        try:
            invite_nodes(base, root, wanted)
        except SwarmError as error:
            failures.append(error)

    thread = threading.Thread(target=run, name="invite")
    before = len(base.stdout.getvalue().splitlines())
    thread.start()

    def token(platform: str) -> str:
        place, deadline = wanted.platforms.index(platform), time.monotonic() + WAIT_S
        while time.monotonic() < deadline:
            lines = base.stdout.getvalue().splitlines()[before:]
            if len(lines) > place:
                return lines[place].split()[3]
            assert thread.is_alive(), failures
            os.sched_yield()
        raise AssertionError(base.stderr.getvalue())

    try:
        yield token
        thread.join(WAIT_S)
        assert not thread.is_alive()
    finally:
        thread.join(2 * WAIT_S)
    if failures:
        raise failures[0]
