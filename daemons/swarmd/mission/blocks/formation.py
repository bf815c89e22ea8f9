"""Formation: keeps a slot beside a leader, at rest or along a course."""

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.vehicle import Way, arrived
from swarmware.geometry.formation import place
from swarmware.mission import catalogue
from swarmware.types.navigation import GoalKind, NavStatus


class FormationBlock:
    """Moves into a slot; with `advance`, keeps it to the end of the course."""

    spec = spec("Formation")

    async def run(self, context: Context) -> None:
        """Ends when the slot was kept long enough, or the end of the course is reached."""
        params: catalogue.Formation = context.params
        forward_m, left_m = place(params.shape, params.slot, params.spacing_m)
        ahead_m, across_m, up_m = params.offset_m
        way = Way()

        def progress(status: NavStatus) -> None:
            ratio = way.ratio(status)
            context.report(ratio, f"{status.formation_error_m:.1f} m off its slot, {status.state}")

        def settled(status: NavStatus) -> bool:
            # the navigator reports arrival in the slot; of an advancing member, at the end of the course
            return arrived(status) and status.formation_error_m < params.tolerance_m

        await context.vehicle.move(
            GoalKind.FORMATION,
            settled,
            progress,
            settle_s=params.settle_s,
            speed_m_s=params.speed_m_s,
            leader=params.leader,
            offset_m=(ahead_m + forward_m, across_m + left_m, up_m),
            course=tuple((x_m, y_m) for x_m, y_m in params.course),
            advance=params.advance,
        )
