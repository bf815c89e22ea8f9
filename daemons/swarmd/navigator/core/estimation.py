"""Estimation of the own pose from the sensors and the state of the vehicle."""

from typing import Final

from swarmd.navigator.config import EstimatorConfig
from swarmd.navigator.core.estimator import Estimator
from swarmware.geometry.geodesy import Origin
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.vehicle import GnssFix, Imu, Pose, Setpoint, VehicleState

STOP: Final = Setpoint(0.0)


class PoseEstimation:
    """Connects the estimator with the state of the vehicle, from which rest and landing are known."""

    def __init__(self, config: EstimatorConfig, origin: Origin, *, flies: bool, hovers: bool) -> None:
        self._estimator = Estimator(config, origin, flies=flies)
        self._hovers = hovers
        """True if the vehicle touches down without rolling."""
        self._vehicle: VehicleState | None = None
        self._by_hand = False
        self._setpoint = STOP

    def on_gnss(self, fix: GnssFix, stamp_ns: int) -> None:
        """Takes a position fix."""
        self._estimator.on_gnss(fix, stamp_ns)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Takes rates, specific force and heading."""
        self._estimator.on_imu(imu, stamp_ns)

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground."""
        self._estimator.on_height(height_m)

    def on_vehicle(self, state: VehicleState) -> None:
        """Takes the state of the vehicle with armed and landed."""
        self._vehicle = state

    def on_control(self, control: ControlState) -> None:
        """Takes the driver of the vehicle; a vehicle driven by hand may move at any time."""
        self._by_hand = control.mode is not DriveMode.AUTO

    def on_setpoint(self, setpoint: Setpoint) -> None:
        """Takes the set-point in force; a set-point that moves the vehicle ends a rest."""
        self._setpoint = setpoint

    @property
    def resting(self) -> bool:
        """True if the vehicle is disarmed and on the ground."""
        return self._vehicle is not None and self._vehicle.resting

    def step(self, now_ns: int, late_ns: int = 0) -> Pose | None:
        """Computes the present pose, or None if it is invalid; `late_ns`: scheduling delay of this step."""
        vehicle, estimator = self._vehicle, self._estimator
        landed = vehicle is not None and vehicle.landed
        armed = vehicle is not None and vehicle.armed
        # an armed vehicle on the ground may start at any time when it is driven by hand
        estimator.on_driven(not landed or (armed and (self._by_hand or self._setpoint != STOP)))
        estimator.predict(now_ns)
        if landed and armed and self._hovers:
            estimator.on_landed()
        return estimator.pose(late_ns)
