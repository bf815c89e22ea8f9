"""Orders to a chassis and its reports, which the hardware abstraction exchanges with motors and steering."""

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.bounds import Finite, Ratio
from swarmware.types.registry import register


class ChassisAction(OpenEnum):
    """Action of an order to a chassis."""

    ARM = "arm"
    DISARM = "disarm"
    KILL = "kill"
    """Motors off at once, also in the air."""
    GAINS = "gains"
    """Change gains of its controllers."""
    CALIBRATE = "calibrate"
    """Teach the motor controllers the range of the throttle; the motors may turn."""


@register
class ChassisOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Order to a chassis, which executes each once and states its number in its next report."""

    number: int
    """Number of the order, which rises; a repeated order keeps its number."""
    action: ChassisAction
    gains: dict[str, Finite] = {}
    """New gains by name; the chassis keeps its other gains."""


@register
class ChassisReport(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Report of a chassis."""

    armed: bool
    landed: bool
    answered: int = 0
    """Number of the newest order that was executed or refused."""
    refused: str = ""
    """Reason of the refusal of that order, or "" if it was executed."""
    calibrating: bool = False
    """Whether the motor controllers are being calibrated."""


@register
class ActuatorOutputs(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Outputs of a flight controller to motors and servos; without any, the motors stop."""

    motors: tuple[Ratio, ...] = ()
    """Throttle of each motor controller, from 0 (stopped) to 1 (full), in the order of the airframe."""
    servos: tuple[Ratio, ...] = ()
    """Deflection of each servo, from -1 to 1."""


@register
class GainsRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Change gains of the controllers of a chassis (`sys/vehicle/gains`)."""

    gains: dict[str, Finite]
    """New gains by name; the chassis keeps its other gains."""


@register
class CalibrationRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Calibrate the motor controllers of a disarmed vehicle (`sys/vehicle/calibrate`)."""

    platform: str
    """Name of the vehicle; a request with another name is refused."""


class SensorCalibrationKind(OpenEnum):
    """Part of an inertial unit that is calibrated."""

    GYRO = "gyro"
    """Bias of the gyro, at rest."""
    ACCELEROMETER = "accelerometer"
    """Offset and scale, by one request in each of six attitudes."""
    LEVEL = "level"
    """Mounting of the unit in a vehicle that stands level."""
    COMPASS = "compass"
    """Error of the heading, by the true one."""
    RESET = "reset"
    """Remove all corrections."""


@register
class SensorCalibration(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Calibrate the inertial unit of a vehicle at rest (`sys/vehicle/calibrate_sensor`)."""

    platform: str
    """Name of the vehicle; a request with another name is refused."""
    kind: SensorCalibrationKind
    heading_rad: Finite | None = None
    """True heading, 0 is east, counter-clockwise; for the compass."""
    driver: str = ""
    """Driver of the unit; "" selects the first one."""


@register
class SensorCalibrated(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of `sys/vehicle/calibrate_sensor`."""

    driver: str
    kind: SensorCalibrationKind
    text: str
    """Result of the calibration, for operators."""
    missing: tuple[str, ...] = ()
    """Attitudes of the vehicle that are still missing; without them nothing is corrected."""
