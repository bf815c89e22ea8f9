"""Calibration of inertial units: bias, scale and mounting from samples of a vehicle at rest (S2.47)."""

import math
from collections.abc import Sequence
from typing import Final

import msgspec

from swarmware.errors import Denied
from swarmware.geometry.attitude import Matrix, Vector, from_euler, matrix, to_map
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.vehicle import Imu

SAMPLES_MIN: Final = 20
"""Minimum number of samples, so that the noise of a MEMS unit averages out."""
STILL_RAD_S: Final = 0.05
STILL_M_S2: Final = 0.5
"""Standard deviations above which the vehicle was moved, several times the noise of a MEMS unit."""
BIAS_MAX_RAD_S: Final = 0.2
"""Maximum plausible bias, twice the typical 5 °/s of the worst supported chip (MPU-6000, at most 20 °/s)."""
TILT_MAX_RAD: Final = 0.35
"""Maximum tilt of the mounting; a larger tilt means that the axes are configured in the wrong order."""
OFFSET_MAX_M_S2: Final = 2.0
SCALE_ERROR_MAX: Final = 0.1
"""Maximum plausible error of the scale; a larger error comes from a wrong range or mounting."""
FACE_RATIO: Final = 0.85
"""Ratio of gravity along an axis above which the axis counts as vertical, within 32°."""
FACES: Final = {
    (0, 1): "nose up",
    (0, -1): "nose down",
    (1, 1): "left side up",
    (1, -1): "right side up",
    (2, 1): "level",
    (2, -1): "upside down",
}
"""Attitudes of a vehicle, by the axis that points up and its sign."""
_NONE: Final = (0.0, 0.0, 0.0)


class ImuCorrection(msgspec.Struct, frozen=True):
    """Calibration that is applied to the samples of one inertial unit."""

    gyro_bias_rad_s: Vector = _NONE
    force_offset_m_s2: Vector = _NONE
    force_scale: Vector = (1.0, 1.0, 1.0)
    roll_rad: float = 0.0
    """Roll of the mounting relative to the vehicle, positive with the left side up."""
    pitch_rad: float = 0.0
    """Pitch of the mounting relative to the vehicle, positive with the nose down."""
    yaw_rad: float = 0.0
    """Angle that is added to the measured heading."""

    def force(self, imu: Imu) -> Vector:
        """Specific force with corrected offset and scale, in the axes of the unit."""
        x, y, z = (
            (value - offset) * scale
            for value, offset, scale in zip(
                (imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2), self.force_offset_m_s2, self.force_scale, strict=True
            )
        )
        return x, y, z


class ImuCorrector:
    """Applies a correction to samples; without a correction the samples pass unchanged."""

    def __init__(self, correction: ImuCorrection | None = None) -> None:
        self.correction = correction or ImuCorrection()
        self._trivial = self.correction == ImuCorrection()
        self._mounting: Matrix = matrix(from_euler(self.correction.roll_rad, self.correction.pitch_rad, 0.0))

    def apply(self, imu: Imu) -> Imu:
        """The sample with the correction applied."""
        # most units are not calibrated, and each sample would cost two rotations
        if self._trivial:
            return imu
        one = self.correction
        bias = one.gyro_bias_rad_s
        rates = to_map(
            self._mounting, (imu.wx_rad_s - bias[0], imu.wy_rad_s - bias[1], imu.wz_rad_s - bias[2])
        )
        yaw = None if imu.yaw_rad is None else math.remainder(imu.yaw_rad + one.yaw_rad, math.tau)
        roll = None if imu.roll_rad is None else imu.roll_rad - one.roll_rad
        pitch = None if imu.pitch_rad is None else imu.pitch_rad - one.pitch_rad
        return Imu(*rates, *to_map(self._mounting, one.force(imu)), yaw, roll, pitch)


def gyro(samples: Sequence[Imu], former: ImuCorrection) -> ImuCorrection:
    """Calibrates the bias of the gyro. Raises: Denied when the vehicle moved, or the bias is implausible."""
    check_still(samples)
    bias = _mean([_rates(one) for one in samples])
    if max(map(abs, bias)) > BIAS_MAX_RAD_S:
        raise Denied(
            f"gyro: bias of {_text(bias)} rad/s, expected at most {BIAS_MAX_RAD_S:g}; the vehicle turns"
        )
    return msgspec.structs.replace(former, gyro_bias_rad_s=bias)


def level(samples: Sequence[Imu], former: ImuCorrection) -> ImuCorrection:
    """Calibrates the mounting of the unit in a level vehicle. Raises: Denied as `gyro`."""
    check_still(samples)
    x, y, z = _mean([former.force(one) for one in samples])
    roll, pitch = math.atan2(y, z), math.atan2(-x, math.hypot(y, z))
    if max(abs(roll), abs(pitch)) > TILT_MAX_RAD:
        raise Denied(
            f"level: tilted by {roll:.2f} and {pitch:.2f} rad, expected at most {TILT_MAX_RAD:g}: stand the"
            " vehicle level, or correct the axes of the unit"
        )
    return msgspec.structs.replace(former, roll_rad=roll, pitch_rad=pitch)


def compass(samples: Sequence[Imu], former: ImuCorrection, heading_rad: float) -> ImuCorrection:
    """Calibrates the heading in a vehicle whose true heading is known. Raises: Denied as `gyro`."""
    check_still(samples)
    found = [one.yaw_rad for one in samples if one.yaw_rad is not None]
    if len(found) < SAMPLES_MIN:
        raise Denied("compass: this unit measures no heading")
    # the mean of directions, since the headings may lie on both sides of ±180°
    mean = math.atan2(math.fsum(map(math.sin, found)), math.fsum(map(math.cos, found)))
    return msgspec.structs.replace(former, yaw_rad=math.remainder(heading_rad - mean, math.tau))


class AccelerometerFaces:
    """Collects gravity in six attitudes of a vehicle, from which offset and scale follow.

    Source: Frosio, Pedersini, Borghese 2009, "Autocalibration of MEMS accelerometers", IEEE Trans.
    Instrumentation and Measurement 58. With known directions the problem is linear.
    """

    def __init__(self) -> None:
        self._along: dict[tuple[int, int], float] = {}

    def add(self, samples: Sequence[Imu]) -> str:
        """Takes the samples of one attitude; returns its name.

        Raises: Denied when the vehicle moved or is oblique.
        """
        check_still(samples)
        # uncorrected, as a former calibration is replaced and not refined
        mean = _mean([_force(one) for one in samples])
        # the axis that carries most of gravity is the vertical one
        axis = max(range(3), key=lambda index: abs(mean[index]))
        if abs(mean[axis]) < FACE_RATIO * GRAVITY_M_S2:
            raise Denied(f"accelerometer: {_text(mean)} m/s²: expected one axis of the vehicle upright")
        face = (axis, 1 if mean[axis] > 0 else -1)
        self._along[face] = mean[axis]
        return FACES[face]

    @property
    def missing(self) -> tuple[str, ...]:
        """Attitudes without samples yet."""
        return tuple(name for face, name in FACES.items() if face not in self._along)

    def result(self, former: ImuCorrection) -> ImuCorrection:
        """Offset and scale of the three axes. Raises: Denied when they are implausible."""
        ups = [self._along[axis, 1] for axis in range(3)]
        downs = [self._along[axis, -1] for axis in range(3)]
        x, y, z = ((up + down) / 2 for up, down in zip(ups, downs, strict=True))
        u, v, w = (2 * GRAVITY_M_S2 / (up - down) for up, down in zip(ups, downs, strict=True))
        if max(map(abs, (x, y, z))) > OFFSET_MAX_M_S2 or max(abs(k - 1) for k in (u, v, w)) > SCALE_ERROR_MAX:
            raise Denied(
                f"accelerometer: offset {_text((x, y, z))} m/s², scale {_text((u, v, w))}: expected at most"
                f" {OFFSET_MAX_M_S2:g}, and 1 ± {SCALE_ERROR_MAX:g}"
            )
        return msgspec.structs.replace(former, force_offset_m_s2=(x, y, z), force_scale=(u, v, w))


def check_still(samples: Sequence[Imu]) -> None:
    """Checks that there are enough samples of a vehicle at rest. Raises: Denied."""
    if len(samples) < SAMPLES_MIN:
        raise Denied(f"{len(samples)} samples of the inertial unit, expected at least {SAMPLES_MIN}")
    turns = max(map(_deviation, zip(*map(_rates, samples), strict=True)))
    pushes = max(map(_deviation, zip(*map(_force, samples), strict=True)))
    if turns > STILL_RAD_S or pushes > STILL_M_S2:
        raise Denied(f"the vehicle moved: {turns:.2f} rad/s, {pushes:.2f} m/s²; expected it at rest")


def _rates(imu: Imu) -> Vector:
    return imu.wx_rad_s, imu.wy_rad_s, imu.wz_rad_s


def _force(imu: Imu) -> Vector:
    return imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2


def _mean(vectors: Sequence[Vector]) -> Vector:
    x, y, z = (math.fsum(axis) / len(vectors) for axis in zip(*vectors, strict=True))
    return x, y, z


def _deviation(values: Sequence[float]) -> float:
    """Standard deviation of values."""
    mean = math.fsum(values) / len(values)
    return math.sqrt(math.fsum((value - mean) ** 2 for value in values) / len(values))


def _text(vector: Vector) -> str:
    return ", ".join(f"{value:.3f}" for value in vector)
