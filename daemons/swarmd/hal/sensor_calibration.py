"""Calibration of inertial units on request, from samples at rest, with corrections stored on disk."""

import logging
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

import msgspec

from swarmd.hal.core import imu_calibration
from swarmd.hal.core.imu_calibration import AccelerometerFaces, ImuCorrection
from swarmd.hal.driver import Device
from swarmd.hal.imu_source import ImuSource
from swarmware.errors import ConfigError, Denied, SwarmError
from swarmware.model import document
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.filewriter import replace_file
from swarmware.runtime.instant import until
from swarmware.types.chassis import SensorCalibrated, SensorCalibration, SensorCalibrationKind
from swarmware.types.vehicle import Imu, VehicleState

log = logging.getLogger("swarm.hal")

WINDOW_NS: Final = 5_000_000_000
"""Time for which samples are collected; at rest a simulated unit sends five a second."""


class SensorCalibrations:
    """Serves `sys/vehicle/calibrate_sensor`, and applies the stored correction to each inertial unit."""

    def __init__(self, module: Module, devices: Callable[[], Iterable[Device]], file: Path) -> None:
        self._module = module
        self._devices = devices
        self._file = file
        self._stored = self._load()
        self._faces: dict[str, AccelerometerFaces] = {}
        self._state = module.reader("vehicle/state", VehicleState)
        self._busy = False

    def _load(self) -> dict[str, ImuCorrection]:
        try:
            return document.json(document.read(self._file), dict[str, ImuCorrection], str(self._file))
        except FileNotFoundError:
            return {}
        except (ConfigError, OSError) as error:
            # not raised: a vehicle without corrections is better than one without drivers
            log.error("%s; inertial units are not corrected until they are calibrated again", error)
            return {}

    def serve(self) -> None:
        """Registers the handler of the request."""
        self._module.serve(
            "sys/vehicle/calibrate_sensor",
            SensorCalibration,
            self._calibrate,
            reply=SensorCalibrated,
            description="Calibrate the inertial unit of a disarmed vehicle at rest",
        )

    def apply(self) -> None:
        """Applies its correction to each unit; must be called after drivers were added."""
        for name, source in self._sources().items():
            source.correction = self._stored.get(name, ImuCorrection())

    def _sources(self) -> dict[str, ImuSource]:
        return {device.name: device for device in self._devices() if isinstance(device, ImuSource)}

    def _chosen(self, request: SensorCalibration) -> tuple[str, ImuSource]:
        """The unit that the request names, or the only one. Raises: Denied."""
        if request.platform != self._module.platform:
            raise Denied(
                f"calibration of {request.platform!r}: this is {self._module.platform}; expected its own name"
            )
        state = self._state.value
        if state is not None and not state.resting:
            raise Denied("calibration: expected a vehicle that is disarmed and on the ground")
        # two windows at a time would share the list of samples
        if self._busy:
            raise Denied("calibration: another one is in progress")
        sources = self._sources()
        name = request.driver or next(iter(sources), "")
        if name not in sources:
            known = ", ".join(sources) or "none"
            raise Denied(f"driver {name!r}: no inertial unit; expected one of: {known}")
        return name, sources[name]

    async def _calibrate(self, request: SensorCalibration, meta: Meta) -> SensorCalibrated:
        name, source = self._chosen(request)
        found = ImuCorrection()
        if request.kind is not SensorCalibrationKind.RESET:
            # the driver then collects its samples uncorrected
            self._busy, source.collected = True, []
            try:
                await until(self._module.clock, self._module.now_ns() + WINDOW_NS)
                samples = source.collected
            finally:
                self._busy, source.collected = False, None
            if request.kind is SensorCalibrationKind.ACCELEROMETER:
                faces = self._faces.setdefault(name, AccelerometerFaces())
                attitude = faces.add(samples)
                # the faces are kept in memory for the next requests, one for each attitude
                if faces.missing:
                    return SensorCalibrated(name, request.kind, f"{attitude} taken", faces.missing)
                found = faces.result(source.correction)
            else:
                found = _result(request, samples, source.correction)
        self._faces.pop(name, None)
        # on disk first: a failure leaves the correction in force unchanged
        self._store(name, found)
        source.correction = found
        text = _text(request.kind, found)
        log.warning(
            "driver %s: %s calibrated by %s: %s", name, request.kind, self._module.requester(meta), text
        )
        return SensorCalibrated(name, request.kind, text)

    def _store(self, name: str, correction: ImuCorrection) -> None:
        """Stores a correction on disk for later runs. Raises: SwarmError; then nothing changes."""
        stored = {**self._stored, name: correction}
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            replace_file(self._file, msgspec.json.encode(stored))
        except OSError as error:
            raise SwarmError(f"{self._file}: not written, so not calibrated: {error.strerror}") from error
        self._stored = stored


def _result(request: SensorCalibration, samples: list[Imu], former: ImuCorrection) -> ImuCorrection:
    match request.kind:
        case SensorCalibrationKind.GYRO:
            return imu_calibration.gyro(samples, former)
        case SensorCalibrationKind.LEVEL:
            return imu_calibration.level(samples, former)
        case SensorCalibrationKind.COMPASS if request.heading_rad is not None:
            return imu_calibration.compass(samples, former, request.heading_rad)
        case SensorCalibrationKind.COMPASS:
            raise Denied("compass: expected the true heading of the vehicle")
        case _:
            raise Denied(
                f"calibration {request.kind}: unknown; expected one of {', '.join(SensorCalibrationKind)}"
            )


def _text(kind: SensorCalibrationKind, found: ImuCorrection) -> str:
    """Result of the calibration as a text for operators."""
    match kind:
        case SensorCalibrationKind.GYRO:
            return f"bias {_vector(found.gyro_bias_rad_s)} rad/s"
        case SensorCalibrationKind.LEVEL:
            roll_deg, pitch_deg = math.degrees(found.roll_rad), math.degrees(found.pitch_rad)
            return f"mounted with roll {roll_deg:.2f}°, pitch {pitch_deg:.2f}°"
        case SensorCalibrationKind.COMPASS:
            return f"heading corrected by {math.degrees(found.yaw_rad):.1f}°"
        case SensorCalibrationKind.ACCELEROMETER:
            return f"offset {_vector(found.force_offset_m_s2)} m/s², scale {_vector(found.force_scale)}"
    return "corrections removed"


def _vector(vector: tuple[float, float, float]) -> str:
    return ", ".join(f"{value:.4f}" for value in vector)
