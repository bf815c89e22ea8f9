"""A client of a node that exists in a test only, for commands and programs that take a `Client`."""

from pathlib import Path
from typing import Any

import msgspec

from swarmware.model.clock import Clock
from swarmware.model.config import NodeConfig
from swarmware.model.names import Address
from swarmware.module.client import Client
from swarmware.node.node import Node
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.delivery.outcome import Outcome, Status


class FakeNode(Node):
    """A node without services, sockets and shared memory; a test may lay files in its folder."""

    def __init__(self, config: NodeConfig, clock: Clock) -> None:
        # the constructor of a node makes sockets and files
        self.config_dir = Path(config.run_dir)
        self.config = config
        self.platform = config.platform
        self.address = Address(config.platform, config.unit)
        self.hardware = self.address.hardware
        self.run_dir = config.run_path
        self.clock = clock
        self.table = AppTable(self.run_dir, whole=False)


class FakeClient(Client):
    """A client that keeps what is sent; a test replaces the methods whose answers it decides."""

    def __init__(self, platform: str = "gcs", *, clock: Clock | None = None, **config: Any) -> None:
        super().__init__("fake")
        self._node = FakeNode(NodeConfig(platform=platform, **config), clock or Clock())
        self.sent: list[tuple[str, msgspec.Struct]] = []
        """Messages by their path."""
        self.outcome = Outcome(Status.DELIVERED)
        """The outcome of each message."""

    @property
    def node(self) -> Node:
        """The node of the test."""
        return self._node

    @property
    def clock(self) -> Clock:
        """The clock of the test, or the real one."""
        return self._node.clock

    def now_ns(self) -> int:
        """The present instant on that clock."""
        return self.clock.now_ns()

    async def send(self, path: str, value: msgspec.Struct, **options: Any) -> Outcome:
        """Keep a message, and return the outcome that the test has set."""
        self.sent.append((path, value))
        return self.outcome
