"""Return: to where the vehicle was armed."""

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.vehicle import Way
from swarmware.mission import catalogue
from swarmware.mission.plugin import BlockError
from swarmware.types.vehicle import NavStatus

MIN_HEIGHT_M = 2.0
"""A vehicle that is lower climbs to this before it goes: between is what it did not fly over."""


class ReturnBlock:
    """Moves to where it was armed."""

    spec = spec("Return")

    async def run(self, context: Context) -> None:
        """Until it is above it."""
        params: catalogue.Return = context.params
        vehicle = context.vehicle
        if vehicle.flies and vehicle.landed:
            return  # nothing here takes off by itself
        home = vehicle.home
        if home is None:
            raise BlockError("no_home", "nobody saw where it was armed")
        way = Way()

        def progress(status: NavStatus) -> None:
            context.report(way.ratio(status), f"{status.distance_m:.1f} m to its start")

        await vehicle.move(
            "goto",
            _arrived,
            progress,
            x_m=home.x_m,
            y_m=home.y_m,
            z_m=max(vehicle.height_m, MIN_HEIGHT_M) if vehicle.flies else home.z_m,
            speed_m_s=params.speed_m_s,
        )


def _arrived(status: NavStatus) -> bool:
    return status.state == "arrived"
