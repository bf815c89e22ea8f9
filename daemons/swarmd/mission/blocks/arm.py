"""Arm and Disarm: switch the motors on and off."""

from swarmd.mission.blocks.context import Context, spec


class ArmBlock:
    """Arms the motors of the vehicle."""

    spec = spec("Arm")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle reports that it is armed."""
        await context.vehicle.arm(True)


class DisarmBlock:
    """Disarms the motors of the vehicle."""

    spec = spec("Disarm")

    async def run(self, context: Context) -> None:
        """Ends when the vehicle reports that it is disarmed."""
        await context.vehicle.arm(False)
