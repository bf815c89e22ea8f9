"""Hold: the vehicle stays at its position."""

import asyncio

from swarmd.mission.blocks.context import Context, spec
from swarmware.mission import catalogue
from swarmware.types.vehicle import NavStatus


class HoldBlock:
    """Stays where it is, for a while or for good."""

    spec = spec("Hold")

    async def run(self, context: Context) -> None:
        """Until it stands still, then for the time that the mission says."""
        params: catalogue.Hold = context.params

        def progress(status: NavStatus) -> None:
            context.report(0.0, status.state)

        await context.vehicle.move("hold", _still, progress)
        await asyncio.sleep(params.s)


def _still(status: NavStatus) -> bool:
    return status.state in {"holding", "arrived", "idle"}
