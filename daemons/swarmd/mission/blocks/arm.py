"""Arm and Disarm: the motors."""

from swarmd.mission.blocks.context import Context, spec


class ArmBlock:
    """Arms the motors."""

    spec = spec("Arm")

    async def run(self, context: Context) -> None:
        """Until the vehicle says so."""
        await context.vehicle.arm(True)


class DisarmBlock:
    """Disarms the motors."""

    spec = spec("Disarm")

    async def run(self, context: Context) -> None:
        """Until the vehicle says so."""
        await context.vehicle.arm(False)
