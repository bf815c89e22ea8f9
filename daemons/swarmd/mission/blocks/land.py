"""Land: descends straight down; a vehicle that does not fly stops."""

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.vehicle import Way
from swarmware.mission import catalogue
from swarmware.types.vehicle import NavStatus


class LandBlock:
    """Lands the vehicle at its position."""

    spec = spec("Land")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle stands on the ground."""
        params: catalogue.Land = context.params
        way = Way()

        def progress(status: NavStatus) -> None:
            context.report(way.ratio(status), f"{status.distance_m:.1f} m above the ground")

        await context.vehicle.move("land", _arrived, progress, speed_m_s=params.speed_m_s)


def _arrived(status: NavStatus) -> bool:
    return status.state == "arrived"
