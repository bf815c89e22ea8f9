"""Calibration of the motor controllers of a vehicle."""

import msgspec

from swarmctl.session.session import Session
from swarmware.model import names
from swarmware.types.chassis import CalibrationRequest
from swarmware.types.vehicle import VehicleState

PATH = "sys/vehicle/calibrate"


class CalibrationStarted(msgspec.Struct, frozen=True):
    """The motor controllers of a vehicle are being calibrated."""

    platform: str
    vehicle: VehicleState
    """Its state when it had accepted the order."""


async def calibrate_motors(session: Session, platform: str) -> None:
    """Starts the calibration; the vehicle refuses unless it is disarmed and on the ground."""
    await session.reach(platform)
    state = await session.ask(names.join(platform, PATH), CalibrationRequest(platform), VehicleState)
    if session.settings.structured:
        session.out.document(CalibrationStarted(platform, state))
    else:
        session.out.say(f"{platform}: the motor controllers are being calibrated")
