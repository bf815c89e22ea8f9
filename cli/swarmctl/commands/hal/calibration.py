"""Calibration of the motor controllers and of the inertial unit of a vehicle."""

import math
from typing import Final

import msgspec

from swarmctl.session.session import Session
from swarmware.model import names
from swarmware.types.chassis import (
    CalibrationRequest,
    SensorCalibrated,
    SensorCalibration,
    SensorCalibrationKind,
)
from swarmware.types.vehicle import VehicleState

PATH = "sys/vehicle/calibrate"
SENSOR_PATH = "sys/vehicle/calibrate_sensor"
WINDOW_S: Final = 5.0
"""Time for which the vehicle collects samples before it answers."""


class CalibrationStarted(msgspec.Struct, frozen=True):
    """The motor controllers of a vehicle are being calibrated, or its inertial unit was."""

    platform: str
    vehicle: VehicleState | None = None
    """State of the vehicle that accepted the order to its motors, or null for the inertial unit."""
    sensor: SensorCalibrated | None = None
    """Result of the inertial unit, or null for a calibration of the motors."""


async def calibrate_motors(session: Session, platform: str) -> None:
    """Starts the calibration; the vehicle refuses unless it is disarmed and on the ground."""
    await session.reach(platform)
    state = await session.ask(names.join(platform, PATH), CalibrationRequest(platform), VehicleState)
    if session.settings.structured:
        session.out.document(CalibrationStarted(platform, state))
    else:
        session.out.say(f"{platform}: the motor controllers are being calibrated")


async def calibrate_sensor(
    session: Session, platform: str, kind: str, heading_deg: float | None, driver: str
) -> None:
    """Calibrates the inertial unit; the vehicle refuses unless it is disarmed and at rest."""
    await session.reach(platform)
    # from a compass, clockwise from north, to the map, counter-clockwise from east
    heading_rad = None if heading_deg is None else math.radians(90.0 - heading_deg)
    request = SensorCalibration(platform, SensorCalibrationKind(kind), heading_rad, driver)
    if kind != SensorCalibrationKind.RESET:
        session.out.say(f"{platform}: do not move it for {WINDOW_S:g} s")
    # the answer comes after the window of samples
    wait_s = WINDOW_S + session.settings.timeout_s
    found = await session.ask(names.join(platform, SENSOR_PATH), request, SensorCalibrated, timeout_s=wait_s)
    if session.settings.structured:
        session.out.document(CalibrationStarted(platform, sensor=found))
        return
    session.out.text(f"{platform}: {found.driver}: {found.text}")
    if found.missing:
        session.out.say(f"turn it, and repeat the command; still missing: {', '.join(found.missing)}")
