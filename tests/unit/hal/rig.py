"""A hardware abstraction with devices of a test, on a node in a temporary folder."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from unittest.mock import patch

from swarmd.hal.config import Config
from swarmd.hal.driver import Device
from swarmd.hal.service import Hal
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node


@asynccontextmanager
async def running(root: Path, devices: Sequence[Device], config: Config) -> AsyncIterator[Module]:
    """Runs the service with these devices; yields a second module of the node."""
    async with tmp_node(root) as node, Module("hal", node=node) as module, Module("test", node=node) as other:
        with patch("swarmd.hal.service.make_all", return_value=list(devices)):
            task = asyncio.create_task(Hal(module, config).run(), name="hal")
            try:
                yield other
            finally:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task
