"""The block MyName: the vehicle visits the corners of a square, and returns."""

from typing import Annotated, ClassVar

import msgspec
from swarmware.mission.catalogue import MOTION_ERRORS, BlockType, Params
from swarmware.mission.plugin import BlockContext
from swarmware.model.platform_kind import VEHICLES


class Parameters(Params, frozen=True):
    """Parameters that a mission gives the block; the check refuses a value outside its bounds."""

    side_m: Annotated[float, msgspec.Meta(gt=0, le=500)] = 10.0
    """Length of a side of the square."""
    speed_m_s: Annotated[float, msgspec.Meta(gt=0, le=30)] = 2.0
    """Speed along the sides."""
    rounds: Annotated[int, msgspec.Meta(ge=1, le=100)] = 1
    """Number of times round the square."""

    @property
    def lasts_s(self) -> float:
        """Time on the way, which is added to the time-out of the block."""
        return self.rounds * 4 * self.side_m / self.speed_m_s


def plan(params: Parameters, x_m: float, y_m: float) -> list[tuple[float, float]]:
    """The corners to visit, from the present position and back to it; replace it by your plan."""
    side_m = params.side_m
    corners = [(x_m + side_m, y_m), (x_m + side_m, y_m + side_m), (x_m, y_m + side_m), (x_m, y_m)]
    return corners * params.rounds


class MyName:
    """Executes the plan; one object for each run of the block."""

    spec: ClassVar = BlockType(
        "MyName",
        "Visits the corners of a square, and returns.",
        Parameters,
        timeout_s=60.0,
        kinds=VEHICLES,
        errors=MOTION_ERRORS,
        motion=True,
        airborne=True,
    )

    async def run(self, context: BlockContext) -> None:
        """Move from corner to corner; returns when the last one is reached."""
        params: Parameters = context.params
        vehicle = context.vehicle
        start = vehicle.pose
        corners = plan(params, start.x_m, start.y_m)
        for number, (x_m, y_m) in enumerate(corners, start=1):
            context.report((number - 1) / len(corners), f"to corner {number} of {len(corners)}")
            await vehicle.goto(x_m, y_m, start.z_m, speed_m_s=params.speed_m_s)
