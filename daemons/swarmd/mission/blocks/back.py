"""Return: moves the vehicle to the place where it was armed."""

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.vehicle import Way
from swarmware.mission import catalogue
from swarmware.mission.plugin import BlockError
from swarmware.types.vehicle import NavStatus

MIN_HEIGHT_M = 2.0
"""A vehicle that is lower climbs to this height first: obstacles on the direct way are not known."""


class ReturnBlock:
    """Moves to the place where the vehicle was armed."""

    spec = spec("Return")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle is above that place."""
        params: catalogue.Return = context.params
        vehicle = context.vehicle
        if vehicle.flies and vehicle.landed:
            return  # a landed vehicle does not take off for this block
        home = vehicle.home
        if home is None:
            raise BlockError("no_home", "the place where it was armed is not known")
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
