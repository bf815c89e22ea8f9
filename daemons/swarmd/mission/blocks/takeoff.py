"""Takeoff: the vehicle climbs straight up."""

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.vehicle import Way
from swarmware.mission import catalogue
from swarmware.types.vehicle import NavStatus


class TakeoffBlock:
    """Climbs straight up to an altitude."""

    spec = spec("Takeoff")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle has reached the altitude."""
        params: catalogue.Takeoff = context.params
        way = Way()

        def progress(status: NavStatus) -> None:
            context.report(way.ratio(status), f"{status.distance_m:.1f} m to climb")

        await context.vehicle.move(
            "takeoff", _arrived, progress, z_m=params.altitude_m, speed_m_s=params.speed_m_s
        )


def _arrived(status: NavStatus) -> bool:
    return status.state == "arrived"
