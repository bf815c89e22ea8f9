"""The module my_name: publishes a value, and answers a command.

Run it on a node:  SWARM_CONFIG=/etc/swarm python my_name.py
"""

import asyncio
import logging

from swarmware import Module
from swarmware.module.meta import Meta
from swarmware.types.scalar import Float

RATE_HZ = 2.0


class MyName:
    """The resources of this module, and what it does with them."""

    def __init__(self, module: Module) -> None:
        self._module = module
        self._offset = 0.0
        self._board = module.writer(
            "my_name/value",
            Float,
            rate_hz=RATE_HZ,
            description="The newest value",
        )
        module.serve(
            "cmd/my_name",
            Float,
            self.set_offset,
            reply=Float,
            description="Set the offset; the answer is the old one",
        )

    def measure(self) -> Float:
        """The present value."""
        return Float(20.0 + self._offset)  # replace it by your measurement

    def set_offset(self, offset: Float, meta: Meta) -> Float:
        """Answer the command: keep the new offset, return the old one."""
        old, self._offset = self._offset, offset.value
        self._module.log.info("offset %g, was %g", self._offset, old)
        return Float(old)

    async def run(self) -> None:
        """Publish the value until the module ends."""
        async for _ in self._module.every(1 / RATE_HZ):
            self._board.write(self.measure())


async def main() -> None:
    """Join the node of SWARM_CONFIG, and leave it after Ctrl-C or SIGTERM."""
    async with Module("my_name") as module:
        await MyName(module).run()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)  # `module.log` prints to stderr
    asyncio.run(main())
