"""Blocks that switch the motors, and those that move the vehicle alone."""

import asyncio
from typing import Final

from swarmd.mission.blocks.context import Context, spec
from swarmd.mission.core.way_home import RETURN_HEIGHT_M
from swarmd.mission.vehicle import Progress, Way, arrived
from swarmware.mission import catalogue
from swarmware.mission.plugin import BlockError
from swarmware.types.navigation import GoalKind, NavState

AT_REST: Final = frozenset({NavState.HOLDING, NavState.ARRIVED, NavState.IDLE})


class ForcedArm(catalogue.Nothing, frozen=True):
    """Parameters of an arming that an operator forces; no mission file can have them."""

    reason: str
    """Operator that forces it, and the reason."""


class ArmBlock:
    """Arms the motors of a vehicle that is ready, or whose arming is forced."""

    spec = spec("Arm")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle reports that it is armed."""
        forced = context.params if isinstance(context.params, ForcedArm) else None
        await context.vehicle.arm(True, force="" if forced is None else forced.reason)


class DisarmBlock:
    """Disarms the motors of the vehicle."""

    spec = spec("Disarm")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle reports that it is disarmed."""
        await context.vehicle.arm(False)


class TakeoffBlock:
    """Climbs straight up to an altitude."""

    spec = spec("Takeoff")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle has reached the altitude."""
        params: catalogue.Takeoff = context.params
        await context.vehicle.move(
            GoalKind.TAKEOFF,
            arrived,
            remaining(context, "m to climb"),
            z_m=params.altitude_m,
            speed_m_s=params.speed_m_s,
        )


class LandBlock:
    """Lands the vehicle at its position, or stops a vehicle that does not fly."""

    spec = spec("Land")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle stands on the ground."""
        params: catalogue.Land = context.params
        progress = remaining(context, "m above the ground")
        kind = GoalKind.DESCEND if params.blind else GoalKind.LAND
        await context.vehicle.move(kind, arrived, progress, speed_m_s=params.speed_m_s)


class GotoBlock:
    """Moves the vehicle to a position."""

    spec = spec("Goto")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle has arrived."""
        params: catalogue.Goto = context.params
        vehicle = context.vehicle
        z_m = params.z_m if params.z_m is not None else vehicle.height_m if vehicle.flies else 0.0
        await vehicle.goto(
            params.x_m,
            params.y_m,
            z_m,
            yaw_rad=params.yaw_rad,
            speed_m_s=params.speed_m_s,
            progress=remaining(context, "m to go"),
        )


class WaypointsBlock:
    """Moves the vehicle to several positions."""

    spec = spec("Waypoints")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle has arrived at the last position and stayed there."""
        params: catalogue.Waypoints = context.params
        vehicle = context.vehicle
        for number, (x_m, y_m, *z_m) in enumerate(params.points_m):
            await vehicle.goto(
                x_m,
                y_m,
                z_m[0] if z_m else vehicle.height_m if vehicle.flies else 0.0,
                speed_m_s=params.speed_m_s,
                progress=_part_of_way(context, number, len(params.points_m)),
            )
            if params.loiter_s:
                await asyncio.sleep(params.loiter_s)


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
        await vehicle.goto(
            home.x_m,
            home.y_m,
            max(vehicle.height_m, RETURN_HEIGHT_M) if vehicle.flies else home.z_m,
            speed_m_s=params.speed_m_s,
            progress=remaining(context, "m to its start"),
        )


class HoldBlock:
    """Holds the position, for a time or without end."""

    spec = spec("Hold")

    async def run(self, context: Context) -> None:
        """Waits until the vehicle is at rest, then for the time in the mission."""
        params: catalogue.Hold = context.params
        await context.vehicle.move(
            GoalKind.HOLD,
            lambda status: status.state in AT_REST,
            lambda status: context.report(0.0, status.state),
        )
        await asyncio.sleep(params.s)


def _part_of_way(context: Context, number: int, count: int) -> Progress:
    """Reports the share of all legs that is done, and the distance to the next position."""
    way = Way()
    return lambda status: context.report(
        (number + way.ratio(status)) / count, f"{status.distance_m:.1f} m to position {number + 1} of {count}"
    )


def remaining(context: Context, what: str) -> Progress:
    """Reports the share of the way that is done, and the distance that remains."""
    way = Way()
    return lambda status: context.report(way.ratio(status), f"{status.distance_m:.1f} {what}")
