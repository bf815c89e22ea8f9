"""A functional module as a user writes it: no word about signals."""

import asyncio
import sys

from swarmware.module.module import Module
from swarmware.types.scalar import Float


async def main() -> None:
    async with Module("thermometer", config_dir=sys.argv[1]) as m:
        heat = m.writer("motor/heat", Float, rate_hz=10.0)
        async for tick in m.every(0.1):
            heat.write(Float(float(tick)))
            if tick == 1:
                print("running", flush=True)


asyncio.run(main())
