"""Hold: the vehicle stays at its position."""

import asyncio

from swarmd.mission.blocks.context import Context, spec
from swarmware.mission import catalogue
from swarmware.types.vehicle import NavStatus


class HoldBlock:
    """Holds the position, for a time or without end."""

    spec = spec("Hold")

    async def run(self, context: Context) -> None:
        """Waits until the vehicle is at rest, then for the time in the mission."""
        params: catalogue.Hold = context.params

        def progress(status: NavStatus) -> None:
            context.report(0.0, status.state)

        await context.vehicle.move("hold", _still, progress)
        await asyncio.sleep(params.s)


def _still(status: NavStatus) -> bool:
    return status.state in {"holding", "arrived", "idle"}
