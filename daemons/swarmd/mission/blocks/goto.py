"""Goto: moves the vehicle to one position."""

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.vehicle import Way
from swarmware.mission import catalogue
from swarmware.types.vehicle import NavStatus


class GotoBlock:
    """Moves the vehicle to a position."""

    spec = spec("Goto")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle has arrived."""
        params: catalogue.Goto = context.params
        vehicle = context.vehicle
        z_m = params.z_m if params.z_m is not None else vehicle.height_m if vehicle.flies else 0.0
        way = Way()

        def progress(status: NavStatus) -> None:
            context.report(way.ratio(status), f"{status.distance_m:.1f} m to go")

        await vehicle.move(
            "goto",
            _arrived,
            progress,
            x_m=params.x_m,
            y_m=params.y_m,
            z_m=z_m,
            yaw_rad=params.yaw_rad,
            speed_m_s=params.speed_m_s,
        )


def _arrived(status: NavStatus) -> bool:
    return status.state == "arrived"
